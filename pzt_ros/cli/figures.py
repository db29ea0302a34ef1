"""`pzt figures`: the thesis' figures, drawn from the models."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(figures)


def figures(
    out: Annotated[Path, typer.Option(help="folder for the page and the pictures")] = Path("figures"),
) -> None:
    """Draw the thesis' figures from the models, each with what the thesis says of it and whether ours agrees.

    Writes index.html, one page that needs nothing else, and every figure as SVG and PNG. Everything in it is simulated.

    Example: pzt figures --out figures
    """
    from pzt_ros.figures.gallery import write_gallery

    console = Console(stderr=True)
    if console.is_terminal:
        with console.status("drawing") as status:
            page = write_gallery(out, tell=lambda number: status.update(f"drawing figure {number}"))
    else:
        page = write_gallery(out)
    typer.echo(page)
