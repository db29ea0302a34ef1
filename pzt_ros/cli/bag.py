"""`pzt bag info` and `pzt bag csv`: what is in a bag, without ROS."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from pzt_ros.bags.export import bag_info, export_csv


def add_to(app: typer.Typer) -> None:
    """Add the commands to the program."""
    group = typer.Typer(no_args_is_help=True, help="Look into bags.")
    group.command()(info)
    group.command()(csv)
    app.add_typer(group, name="bag")


def info(
    bag: Annotated[Path, typer.Argument(help="bag folder or .mcap file")],
    as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False,
) -> None:
    """Topics, counts and rates of a bag.

    Example: pzt bag info run/bag
    """
    found = bag_info(bag)
    if as_json:
        typer.echo(json.dumps(found, indent=1))
    else:
        _show(found)


def _show(found: dict[str, Any]) -> None:
    console = Console()
    table = Table(title=str(found.get("path", "")), title_justify="left")
    for name in ("topic", "type", "messages", "rate, Hz"):
        table.add_column(name, justify="left" if name in ("topic", "type") else "right")
    for topic in found["topics"]:
        rate = topic.get("rate_hz")
        table.add_row(topic["name"], topic["type"], str(topic["count"]), "" if rate is None else f"{rate:.1f}")
    console.print(table)
    if not found.get("complete", True):
        console.print(f"[yellow]not closed properly: {found.get('damage') or 'read up to the last whole message'}[/]")


def csv(
    bag: Annotated[Path, typer.Argument(help="bag folder or .mcap file")],
    out: Annotated[Path, typer.Option(help="folder for the CSV files")],
) -> None:
    """Write every topic of a bag as CSV.

    Example: pzt bag csv run/bag --out run/csv
    """
    for path in export_csv(bag, out):
        typer.echo(path)
