"""`pzt run`: the node graph. ROS is started in processes of its own; this file does not import it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from pzt_ros.errors import BenchError, RunFailedError
from pzt_ros.ros_environment import supervised

RUN_FILES = (
    "bag",
    "log",
    "figures",
    "run.json",
    "scenario.yaml",
    "parameters.yaml",
    "report.html",
    "report.json",
    "recorder.yaml",
)
"""What a run and its report leave in a run folder."""

Out = Annotated[Path | None, typer.Option(help="run folder; runs/SCENARIO-TIME by default")]
Overwrite = Annotated[bool, typer.Option(help="replace the run that is in the run folder")]
AsJson = Annotated[bool, typer.Option("--json", help="the numbers of the report, for programs")]


def add_to(app: typer.Typer) -> None:
    """Add the command to the program."""
    app.command()(run)


def run(
    scenario: Annotated[str, typer.Argument(help="scenario: shipped name or path of a YAML file")] = "scan",
    out: Out = None,
    duration: Annotated[float | None, typer.Option(help="end the scenario after this many seconds of its own")] = None,
    composed: Annotated[bool, typer.Option(help="the loop in one process, the recorder in another")] = False,
    real_time: Annotated[bool, typer.Option(help="keep the pace of the wall clock")] = False,
    priority: Annotated[
        bool, typer.Option(help="with --real-time: real-time priority for the loop, where the system allows it")
    ] = True,
    domain: Annotated[int | None, typer.Option(help="ROS domain; a free one by default")] = None,
    namespace: Annotated[str, typer.Option(help="namespace of the axis")] = "/stage",
    drivers: Annotated[Path | None, typer.Option(help="YAML file of instruments; simulated ones by default")] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
    replay: Annotated[
        Path | None, typer.Option(metavar="BAG", help="run nothing; feed a bag to one node, compare its answers")
    ] = None,
    node: Annotated[str, typer.Option(help="with --replay: observer, controller, amplifier or sensor")] = "observer",
    tolerance: Annotated[
        float, typer.Option(help="with --replay: difference allowed, as share of a column's largest value")
    ] = 1e-9,
) -> None:
    """Start the node graph, run a scenario, record a bag, stop cleanly, write the run's report.

    A scenario that asks for more stroke, slew or current than its model has is refused before anything moves.

    Examples: pzt run scan --out runs/first; pzt run --replay runs/first/bag --node controller
    """
    if replay is not None:
        raise typer.Exit(_replay(replay, node, tolerance, as_json))
    from pzt_ros.axes import axes_of
    from pzt_ros.first_run import compile_once
    from pzt_ros.loop import refuse_what_cannot_be
    from pzt_ros.scenario import load_scenario

    for one in map(load_scenario, [axis.scenario for axis in axes_of(scenario)] or [scenario]):
        compile_once(one, lambda text: typer.echo(text, err=True))
        refuse_what_cannot_be(one)
    options = {"--duration": duration, "--domain": domain, "--namespace": namespace, "--drivers": drivers}
    flags = {"--composed": composed, "--real-time": real_time, "--no-priority": not priority}
    run_and_report(scenario, run_folder(out, scenario, overwrite), options, flags, as_json)


def _replay(bag: Path, node: str, tolerance: float, as_json: bool) -> int:
    """One node against a recorded run, in processes of its own, which say what they find; returns the exit code."""
    command = [sys.executable, "-m", "pzt_bringup.replay", str(bag), "--node", node, "--tolerance", repr(tolerance)]
    return abs(subprocess.run([*command, *["--json"] * as_json], check=False).returncode)


def run_folder(out: Path | None, scenario: str, overwrite: bool) -> Path:
    """Where a run goes; a run that is there already is removed if it may be.

    Raises:
        BenchError: the folder holds a run and may not be overwritten, or what is to be overwritten is no run.
    """
    if out is None:
        return Path("runs") / f"{Path(scenario).stem}-{datetime.now():%Y%m%d-%H%M%S}"
    if not (out / "bag").exists():
        return out
    if not overwrite:
        raise BenchError(f"{out} holds a run already; choose another --out, or say --overwrite")
    if not (out / "run.json").is_file():
        raise BenchError(
            f"{out} holds a bag but no run.json, so it is no run folder to overwrite; choose another --out"
        )
    for name in (*RUN_FILES, *_axes_in(out)):
        path = out / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
    return out


def _axes_in(out: Path) -> list[str]:
    """The folders of a run's axes, where it has several."""
    found: list[str] = json.loads((out / "run.json").read_text(encoding="utf-8")).get("axes", [])
    return found


def run_and_report(
    scenario: str, folder: Path, options: Mapping[str, object], flags: Mapping[str, bool], as_json: bool
) -> None:
    """Run the graph and report on whatever was recorded, also when it failed.

    Raises:
        typer.Exit: with the exit code of the graph, unless it is 0.
        BenchError: the run went well, but there is no report to be made of it.
    """
    from pzt_ros.axes import axes_of

    code = bring_up(scenario, folder, options, flags)
    axes = [(folder / axis.name, axis.scenario) for axis in axes_of(scenario)]
    for run, name in axes or [(folder, scenario)]:
        if code == 0 or (run / "bag").exists():
            _report(run, name, code, as_json)
    if code != 0:
        raise typer.Exit(code)  # the graph has said why


def _report(folder: Path, scenario: str, code: int, as_json: bool) -> None:
    from pzt_ros.report.run import read_summary, write_run_report
    from pzt_ros.scenario import load_scenario

    try:
        page = write_run_report(folder)
        summary = read_summary(folder)
        typer.echo(json.dumps({**summary, "report": str(page)}, indent=1)) if as_json else show(summary, page)
    except BenchError as error:
        idle = isinstance(error, RunFailedError) and load_scenario(scenario).manual  # an operator who enabled nothing
        if code == 0 and not idle:
            raise
        typer.echo(f"no report: {error}", err=True)


def graph_command(scenario: str, folder: Path, options: Mapping[str, object], flags: Mapping[str, bool]) -> list[str]:
    """What starts the graph: options that are None, and flags that are not wanted, are left out."""
    command = [sys.executable, "-m", "pzt_bringup", scenario, "--out", str(folder)]
    command += [word for name, value in options.items() if value is not None for word in (name, str(value))]
    return command + [name for name, wanted in flags.items() if wanted]


def bring_up(scenario: str, folder: Path, options: Mapping[str, object], flags: Mapping[str, bool]) -> int:
    """Run the graph in a process of its own, which says what is wrong; returns its exit code, 1 if killed."""
    process = subprocess.Popen(graph_command(scenario, folder, options, flags), env={**os.environ, **supervised()})

    def pass_on(_number: int, _frame: object) -> None:
        process.terminate()  # it brings the stage to 0 V; in a terminal it has heard of Ctrl-C already

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        code = process.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if code < 0:
        typer.echo(f"error: the graph's supervisor was killed by {signal.Signals(-code).name}; its nodes end", err=True)
    return code if code >= 0 else 1


def show(summary: dict[str, Any], page: Path) -> None:
    """The numbers of a run in the terminal."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    rows = summary["tracking"]
    if rows:
        title = "Tracking error" + (", SIMULATED, against the true displacement" if summary["simulated"] else "")
        table = Table(title=title, title_justify="left")
        table.add_column("controller")
        for heading in ("RMS, nm", "RMS, % of stroke", "max, nm", "max, % of stroke", "better than open loop"):
            table.add_column(heading, justify="right")
        for row in rows:
            table.add_row(row["name"], *_cells(row))
        console.print(table)
    for missing in filter(None, (summary["incomplete"], summary["gaps"])):
        console.print(missing, style="yellow", highlight=False)
    console.print(summary["verdict"], highlight=False)
    console.print(f"report: {page}", highlight=False, soft_wrap=True)


def _cells(row: dict[str, Any]) -> list[str]:
    error = next(iter(row["against"].values()))
    percent = [error["rms_percent_of_stroke"], error["max_percent_of_stroke"]]
    rms, largest = (f"{share:.3f}" if share is not None else "" for share in percent)
    ratio = row["better_than_open_loop"]
    better = f"{ratio:.1f} x" if ratio else ""
    return [f"{1e9 * error['rms_m']:.1f}", rms, f"{1e9 * error['max_m']:.1f}", largest, better]
