"""`pzt bench`: the figures of the README, measured now. The benchmarks are a program of their own, started by name."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import typer


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(bench)


def bench(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            help="benchmarks to run: ticks, measured, physics (by default these), tracking, observer, optimal, panel, "
            "endurance",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="write the tables to this file, too: .md or .json")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="shorter runs; the figures are less sure")] = False,
) -> None:
    """Measure every figure of the README's performance table on this machine, as ratios in one run.

    They take about ten minutes and want an otherwise idle machine. `pzt bench tracking`, every controller on a triangle
    at 1, 10 and 100 Hz, takes five minutes, `pzt bench observer`, 1000 unknown histories, ten,
    `pzt bench endurance`, a simulated hour of the graph in both layouts, forty.

    Example: pzt bench physics --quick --out physics.md
    """
    command = [sys.executable, "-m", "pzt_benchmarks", *(names or [])]
    command += ["--out", str(out)] if out is not None else []
    command += ["--quick"] * quick
    process = subprocess.Popen(command)
    try:
        code = process.wait()
    except KeyboardInterrupt:  # the benchmarks heard it, too
        code = process.wait()
    if code != 0:
        raise typer.Exit(code if code > 0 else 1)
