"""`pzt doctor`: what on this machine is in the way of a graph, and what to do about it."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

SIGNS = {"ok": ("green", "ok"), "note": ("yellow", "note"), "problem": ("red", "PROBLEM")}


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(doctor)


def doctor(as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False) -> None:
    """Look at Python, ROS, discovery, shared memory, domains, cores, clock and priorities; exit code 1 for a problem.

    Example: pzt doctor
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from pzt_ros.doctor import PROBLEM, examine

    findings = examine()
    if as_json:
        typer.echo(json.dumps([asdict(finding) for finding in findings], indent=1))
    else:
        table = Table(show_header=False, box=None, pad_edge=False)
        table.add_column(style="bold", no_wrap=True)
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        for finding in findings:
            style, word = SIGNS[finding.level]
            said = escape(finding.found) + (f"\n[dim]-> {escape(finding.advice)}[/]" if finding.advice else "")
            table.add_row(finding.check, f"[{style}]{word}[/]", said)
        Console().print(table)
    if any(finding.level == PROBLEM for finding in findings):
        raise typer.Exit(1)
