"""`python -m pzt_bringup.replay BAG --node NODE`: one node, given what was recorded; its answers against the recorded.

The node is the real one, in a process of its own, with the parameters of the run; the rest of the graph is played.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from pzt_bringup.child import Child
from pzt_bringup.domain import take_domain
from pzt_bringup.processes import SEPARATE
from pzt_ros.bags.recording import PARTS, Difference
from pzt_ros.errors import BenchError, RunFailedError, named
from pzt_ros.ros_environment import ros_environment, supervised
from pzt_ros.scenario import AS_FAST_AS_POSSIBLE

TOLERANCE = 1e-9
"""Share of a column's largest value: what another processor may round otherwise."""


def main() -> None:
    """The command line."""
    app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    app.command()(command)
    app()


def command(
    bag: Annotated[Path, typer.Argument(help="bag of a run, in its run folder")],
    node: Annotated[str, typer.Option(help=f"one of {', '.join(PARTS)}")] = "observer",
    tolerance: Annotated[float, typer.Option(help="difference allowed, as share of a column's largest")] = TOLERANCE,
    as_json: Annotated[bool, typer.Option("--json", help="for programs")] = False,
) -> None:
    """Replay one node, show the largest difference of each column; exit code 1 if one is beyond the tolerance."""
    try:
        found = replay(bag, node)
    except BenchError as error:
        print(f"error: {error}", file=sys.stderr)
        raise typer.Exit(error.exit_code) from None
    columns = [Difference(**column) for column in found["columns"]]
    beyond = [column for column in columns if column.beyond(tolerance)]
    if as_json:
        print(json.dumps({**found, "tolerance": tolerance, "same": not beyond}, indent=1))
    else:
        print(f"{node}: {found['ticks']} blocks replayed")
        for column in columns:
            verdict = "DIFFERS" if column in beyond else "same"
            print(
                f"  {column.column:26s} largest difference {column.largest:.3g} at {column.at:.4f} s"
                f" (largest value {column.scale:.3g}): {verdict}"
            )
    raise typer.Exit(int(bool(beyond)))


def replay(bag: Path, node: str) -> dict[str, Any]:
    """Start the node with the parameters of its run, and play the rest of the graph.

    Raises:
        BenchError: no such node, no run around the bag, an instrument that cannot be replayed, or no answer.
    """
    named(PARTS, node, "node to replay")
    run = _run_of(bag)
    row = next(row for row in SEPARATE if row.nodes == (node,))
    lock = take_domain(None)
    try:
        with tempfile.TemporaryDirectory(prefix="replay-") as scratch:
            environment = {**ros_environment(Path(scratch) / "ros", lock.domain), **supervised()}
            parameters = Path(scratch) / "parameters.yaml"
            parameters.write_text(yaml.safe_dump(_parameters(run, node)), encoding="utf-8")
            namespace = json.loads((run / "run.json").read_text(encoding="utf-8"))["namespace"]
            words = ["--ros-args", "--params-file", str(parameters), "-r", f"__ns:={namespace}"]
            child = Child(row, words, environment, Path(scratch) / "node.log")
            try:
                return _played(run, bag, node, environment)
            finally:
                child.stop()
    finally:
        lock.release()


def _run_of(bag: Path) -> Path:
    run = bag.absolute().parent  # not that of a bag of several axes, which stands elsewhere
    missing = [name for name in ("parameters.yaml", "run.json", "scenario.yaml") if not (run / name).is_file()]
    if not bag.exists() or missing:
        what = f"no {missing[0]} beside it" if bag.exists() else "no such bag"
        raise BenchError(f"{bag}: {what}; give the bag in the folder of its run, such as runs/first/bag")
    return run


def _parameters(run: Path, node: str) -> dict[str, Any]:
    """The node's parameters in that run; a file that is not where it was is taken from the run folder.

    Raises:
        BenchError: its instrument was none that can be simulated.
    """
    sections = yaml.safe_load((run / "parameters.yaml").read_text(encoding="utf-8"))
    name, section = next((name, s) for name, s in sections.items() if name.endswith(f"/{node}"))
    values = section["ros__parameters"]
    if values.get("driver", "simulated") != "simulated":
        raise BenchError(f"{run}: the {node} had the driver '{values['driver']}'; only a simulated one can be replayed")
    for key in ("chain", "model"):
        if key in values and not Path(values[key]).exists() and (run / Path(values[key]).name).exists():
            values[key] = str(run / Path(values[key]).name)
    if "rate" in values:
        values["rate"] = AS_FAST_AS_POSSIBLE
    if node == "amplifier":  # its watchdog is of the wall clock, and a replay has no pace
        values["limits"].update(command_timeout=60.0, command_age=0.0, sensor_timeout=0.0)
    return {name: section}


def _played(run: Path, bag: Path, node: str, environment: dict[str, str]) -> dict[str, Any]:
    command = [sys.executable, "-m", "pzt_nodes.replay_node", str(run), str(bag), node]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        found: dict[str, Any] = json.loads(done.stdout)
        return found
    lines = done.stderr.strip().splitlines() or ["the replay ended without a word"]
    kind = BenchError if done.returncode == BenchError.exit_code else RunFailedError
    raise kind(lines[-1].removeprefix("error: "))


if __name__ == "__main__":
    main()
