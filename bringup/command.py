"""`python -m pzt_bringup SCENARIO --out DIR`: run the graph; `pzt run` does this and writes the report."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from pzt_bringup.axes import AxesSupervisor
from pzt_bringup.cpu_latency import awake_processor
from pzt_bringup.domain import take_domain
from pzt_bringup.plan import Plan, prepare
from pzt_bringup.supervisor import Outcome, Supervisor
from pzt_bringup.view import TerminalView
from pzt_ros.axes import Axis, axes_of
from pzt_ros.errors import BenchError
from pzt_ros.first_run import compile_once
from pzt_ros.hardware.choose import Drivers, load_drivers
from pzt_ros.scenario import REAL_TIME, load_scenario


def bring_up(
    scenario: Annotated[str, typer.Argument(help="scenario: shipped name or path of a YAML file")] = "scan",
    out: Annotated[Path, typer.Option(help="run folder")] = Path("run"),
    duration: Annotated[
        float | None, typer.Option(help="end after this many seconds: the run's own, or the wall clock's if manual")
    ] = None,
    composed: Annotated[bool, typer.Option(help="the loop in one process, the recorder in another")] = False,
    real_time: Annotated[bool, typer.Option(help="keep the pace of the wall clock")] = False,
    priority: Annotated[
        bool, typer.Option(help="with --real-time: real-time priority for the loop, where the system allows it")
    ] = True,
    domain: Annotated[int | None, typer.Option(help="ROS domain; a free one by default")] = None,
    namespace: Annotated[str, typer.Option(help="namespace of the axis")] = "/stage",
    drivers: Annotated[Path | None, typer.Option(help="YAML file of instruments; simulated ones by default")] = None,
    quiet: Annotated[bool, typer.Option(help="say nothing while running")] = False,
) -> None:
    """Start the node graph, run a scenario, record a bag, stop cleanly."""
    try:
        outcome = run_graph(scenario, out, duration, composed, real_time, domain, namespace, drivers, quiet, priority)
    except BenchError as error:
        outcome = Outcome(error.exit_code, str(error))
    if outcome.exit_code:
        print(f"error: {outcome.sentence}", file=sys.stderr)
    elif not quiet:
        print(outcome.sentence, file=sys.stderr)
    raise typer.Exit(outcome.exit_code)


def run_graph(
    scenario: str,
    out: Path,
    duration: float | None,
    composed: bool,
    real_time: bool,
    domain: int | None,
    namespace: str,
    drivers: Path | None,
    quiet: bool,
    priority: bool = True,
) -> Outcome:
    """Bring the graph up and see it to its end.

    Raises:
        BenchError: bad scenario, run folder, drivers or domain.
    """
    if duration is not None and not duration > 0.0:
        raise BenchError(f"duration {duration} s is not positive; leave it out to run the whole scenario")
    axes = axes_of(scenario)
    if axes and drivers:
        raise BenchError(f"{scenario}: has several axes; name the drivers of each there instead of --drivers")
    chosen = axes or (Axis(namespace.strip("/"), scenario, drivers),)
    lock = take_domain(domain)
    try:
        plans = [
            _plan(axis, out.resolve(), bool(axes), composed, real_time, priority, duration, lock.domain)
            for axis in chosen
        ]
        for plan in plans:
            prepare(plan)
            compile_once(plan.scenario, lambda text: None if quiet else print(text, file=sys.stderr))
        name = " and ".join(plan.scenario.name for plan in plans)
        with awake_processor() as awake, TerminalView(f"{name} in ROS domain {lock.domain}", quiet) as view:
            run = AxesSupervisor(plans, out.resolve(), view.show) if axes else Supervisor(plans[0], view.show)
            outcome = run.run()
    finally:
        lock.release()
    for plan in plans:
        _note_end(plan.folder, outcome, awake)
    return outcome


def _plan(
    axis: Axis,
    out: Path,
    one_of_many: bool,
    composed: bool,
    real_time: bool,
    priority: bool,
    duration: float | None,
    domain: int,
) -> Plan:
    scenario = load_scenario(axis.scenario)
    drivers = load_drivers(axis.drivers) if axis.drivers else Drivers()
    rate, folder = REAL_TIME if real_time else scenario.rate, out / axis.name if one_of_many else out
    neighbour = f"/{axis.neighbour}" if axis.neighbour else ""
    if neighbour and rate != REAL_TIME:
        raise BenchError(f"axis {axis.name} feels {axis.neighbour}, and only the wall clock is common: add --real-time")
    return Plan(
        scenario,
        folder,
        composed,
        rate,
        duration,
        domain,
        f"/{axis.name}",
        drivers,
        own_recorder=not one_of_many,
        neighbour=neighbour,
        priority=priority,
    )


def _note_end(folder: Path, outcome: Outcome, awake: bool) -> None:
    path = folder / "run.json"
    noted = json.loads(path.read_text(encoding="utf-8"))
    noted["processor_kept_awake"] = awake
    noted["outcome"] = {"exit_code": outcome.exit_code, "sentence": outcome.sentence, "status": outcome.status}
    path.write_text(json.dumps(noted, indent=1), encoding="utf-8")


def main() -> None:
    """The command line."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(bring_up)
    app()
