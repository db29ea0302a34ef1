"""Two axes under one supervisor: each as if it were alone, all in one bag, and neither goes on without the other."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pytest
from foreign_node import ForeignNode
from graph_process import GraphProcess, alive
from scenarios import LONG_HOLD, SHORT, write
from std_msgs.msg import Float64MultiArray

from pzt_bringup.replay import replay
from pzt_ros.axes import axes_of
from pzt_ros.bags.reader import open_bag
from pzt_ros.errors import BenchError
from pzt_ros.loop import Tick, run_in_process
from pzt_ros.scenario import load_scenario

SLOWER = SHORT.replace("seed: 7", "seed: 8").replace("to: 120 V, duration: 0.3 s", "to: 110 V, duration: 0.3 s")


def two(folder: Path, x: str, y: str) -> Path:
    """A scenario of two axes."""
    for name, text in (("x", x), ("y", y)):
        (folder / name).mkdir()
        write(folder / name, text)
    path = folder / "two.yaml"
    path.write_text("axes:\n  x: x/scenario.yaml\n  y: {scenario: y/scenario.yaml}\n", encoding="utf-8")
    return path


def alone(scenario: Path) -> np.ndarray:
    """The measurement of an axis that runs by itself, in this process."""
    found: list[np.ndarray] = []

    def watch(tick: Tick) -> None:
        found.append(tick.measurement)

    run_in_process(load_scenario(scenario), watch)
    return np.concatenate(found)


def test_each_axis_runs_as_it_would_alone_and_all_is_in_one_bag(tmp_path: Path) -> None:
    with GraphProcess(two(tmp_path, SHORT, SLOWER), tmp_path / "run", "--composed") as graph:
        code, said = graph.wait()
    assert code == 0, said
    assert "x: run complete; y: run complete" in said
    bag = open_bag(tmp_path / "run" / "bag")
    assert bag.complete
    for axis in ("x", "y"):
        measured = bag.blocks(f"/{axis}/measurement")["displacement_m"]
        np.testing.assert_array_equal(measured, alone(tmp_path / axis / "scenario.yaml"))
        names = {m.name[0] for _, m in bag.messages(f"/{axis}/joint_states")}
        assert names == {axis}
        noted = json.loads((tmp_path / "run" / axis / "run.json").read_text(encoding="utf-8"))
        assert noted["namespace"] == f"/{axis}"
    said_by = {status.name for _, message in bag.messages("/diagnostics") for status in message.status}
    assert {"/x/recorder", "/y/recorder", "/x/amplifier", "/y/amplifier"} <= said_by
    found = replay(tmp_path / "run" / "y" / "bag", "observer")
    assert {column["largest"] for column in found["columns"]} == {0.0}, "an axis' folder is a run folder"


def test_an_axis_that_dies_ends_the_run_of_all(tmp_path: Path) -> None:
    run = GraphProcess(two(tmp_path, LONG_HOLD, LONG_HOLD), tmp_path / "run", "--composed")
    with run as graph, ForeignNode(graph.domain) as foreign:
        for axis in ("x", "y"):
            foreign.listen(f"/{axis}/applied", Float64MultiArray)
        foreign.spin_until(lambda: all(foreign.heard.values()))
        processes = graph.nodes()
        victim = next(p for p in processes if any("/x/" in word for word in p.cmdline()))
        victim.send_signal(signal.SIGKILL)
        code, said = graph.wait()
    assert code == 1
    assert "x: process 'graph' died (killed by SIGKILL)" in said
    assert "y: stopped on request; the amplifier brought the stack to 0 V" in said
    assert alive(processes) == []
    assert open_bag(tmp_path / "run" / "bag").blocks("/y/applied")["voltage_V"][-1] == 0.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("axes: {}", "expected 'axes:' with a scenario for each axis"),
        ("axes: {X: scan}", "axis 'X' cannot be a ROS namespace"),
        ("axes: {x: 3}", "axis x: expected a scenario"),
        ("axes: {x: {drivers: a.yaml}}", "axis x: expected a scenario"),
        ("axes: {x: scan}\nphases: []", "unknown key 'phases' beside 'axes:'"),
    ],
)
def test_axes_that_cannot_be(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "axes.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(BenchError, match=r"axes\.yaml") as caught:
        axes_of(tmp_path / "axes.yaml")
    assert says in str(caught.value)


def test_a_scenario_of_one_axis_has_none() -> None:
    assert axes_of("scan") == ()
