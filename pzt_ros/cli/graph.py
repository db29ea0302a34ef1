"""`pzt run` and `pzt demo`: the node graph. ROS is started in processes of its own; this file does not import it."""

from __future__ import annotations

import subprocess
import sys
from datetime import datetime
from pathlib import Path
from typing import Annotated, Optional

import typer



def add_to(app: typer.Typer) -> None:
    """Add the commands to the program."""
    app.command()(run)


def run(
    scenario: Annotated[str, typer.Argument(help="scenario: shipped name or path of a YAML file")] = "scan",
    out: Annotated[Optional[Path], typer.Option(help="run folder; runs/SCENARIO-TIME by default")] = None,
    duration: Annotated[Optional[float], typer.Option(help="end the scenario after this many seconds of its own")] = None,
    composed: Annotated[bool, typer.Option(help="all nodes in one process")] = False,
    real_time: Annotated[bool, typer.Option(help="keep the pace of the wall clock")] = False,
    domain: Annotated[Optional[int], typer.Option(help="ROS domain; a free one by default")] = None,
    namespace: Annotated[str, typer.Option(help="namespace of the axis")] = "/stage",
) -> None:
    """Start the node graph, run a scenario, record a bag, stop cleanly, write the run's report.

    Example: pzt run scan --out runs/first
    """
    from pzt_ros.report.run import write_run_report

    folder = out or default_folder(scenario)
    options = {"--duration": duration, "--domain": domain, "--namespace": namespace}
    flags = {"--composed": composed, "--real-time": real_time}
    bring_up(scenario, folder, options, flags)
    typer.echo(f"report: {write_run_report(folder)}")


def default_folder(scenario: str) -> Path:
    """A run folder that does not exist yet, named after the scenario and the time."""
    return Path("runs") / f"{Path(scenario).stem}-{datetime.now():%Y%m%d-%H%M%S}"


def bring_up(scenario: str, folder: Path, options: dict[str, object], flags: dict[str, bool]) -> None:
    """Run the graph in a process of its own, which says itself what is wrong.

    Raises:
        typer.Exit: with the exit code of the graph, unless it is 0.

    Raises:
    """
    command = [sys.executable, "-m", "pzt_bringup", scenario, "--out", str(folder)]
    command += [word for name, value in options.items() if value is not None for word in (name, str(value))]
    command += [name for name, wanted in flags.items() if wanted]
    process = subprocess.Popen(command)
    try:
        code = process.wait()
    except KeyboardInterrupt:  # the graph heard it, too, and brings the stage to 0 V
        code = process.wait()
    if code != 0:
        raise typer.Exit(code)  # it has said why
