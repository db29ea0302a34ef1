"""The safety machine on the wire: who stops is named, two senders are one too many, a fault latches until its reset."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from foreign_node import ForeignNode
from graph_process import GraphProcess, alive, wait_until
from lone_amplifier import Amplifier, own_domain
from rclpy.qos import QoSProfile
from scenarios import LONG_HOLD, write
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from pzt_ros.bags.reader import open_bag
from pzt_ros.hardware.guard import Limits

RATE, SIZE = 20e3, 100
LIMITS = Limits()


def log_of(graph: GraphProcess, node: str) -> str:
    path = graph.folder / "log" / f"{node}.log"
    return path.read_text(encoding="utf-8") if path.exists() else ""


def reach_hold(graph: GraphProcess, foreign: ForeignNode) -> None:
    """Until there are 100 V on the stack."""
    foreign.listen("/stage/applied", Float64MultiArray)
    applied = foreign.heard["/stage/applied"]
    foreign.spin_until(lambda: bool(applied) and applied[-1].data[-3] > 99.0)


def check_way_down(graph: GraphProcess) -> None:
    """To 0 V at the safe rate, without a rise, within the declared time."""
    applied = open_bag(graph.folder / "bag").blocks("/stage/applied")
    voltage = applied["voltage_V"]
    begin = int(np.flatnonzero(voltage > 99.0)[-1])
    way = np.diff(voltage[begin:])
    assert voltage[-1] == 0.0
    assert way.max() <= 0.0
    assert -way.min() <= LIMITS.safe_rate / RATE * (1 + 1e-9)


def check_stage_stayed_with(graph: GraphProcess) -> None:
    """The amplifier was alive all the time, so its relay had nothing to do: the stage saw what was put out, no more."""
    bag = open_bag(graph.folder / "bag")
    applied, truth = (bag.blocks(f"/stage/{name}") for name in ("applied", "truth"))
    assert "discharged by its relay" not in log_of(graph, "plant")
    assert np.array_equal(applied.time, truth.time)


# A sensor that stops between two of its readers has measured for the amplifier, and not for the observer.
MISSED = {"sensor": ("no measurement for", "no command for"), "controller": ("no command for",)}


@pytest.mark.parametrize("victim", MISSED)
def test_a_node_that_hangs_is_named(tmp_path: Path, victim: str) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run", "--real-time") as graph:
        with ForeignNode(graph.domain) as foreign:
            reach_hold(graph, foreign)
        processes, hanging = graph.nodes(), graph.node(victim)
        hanging.suspend()
        wait_until(lambda: "amplifier fault: " in log_of(graph, "amplifier"), "the amplifier is at 0 V with a fault")
        hanging.resume()
        code, said = graph.wait()
    assert code == 1, said
    missed = [words for words in MISSED[victim] if words in log_of(graph, "amplifier")]
    assert len(missed) == 1
    assert missed[0] in said
    assert f"process '{victim}' hung for more than 3 s" in said
    assert said.count(" hung ") == 1
    assert alive(processes) == []
    check_way_down(graph)
    check_stage_stayed_with(graph)


def test_a_plant_without_processor_time_misses_nothing_of_a_ramp(tmp_path: Path) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run", "--real-time") as graph:
        with ForeignNode(graph.domain) as foreign:
            reach_hold(graph, foreign)
            plant, applied = graph.node("plant"), foreign.heard["/stage/applied"]
            discharge = foreign.node.create_client(Trigger, "/stage/discharge")
            discharge.call_async(Trigger.Request())
            foreign.spin_until(lambda: applied[-1].data[-3] < 90.0)
            plant.suspend()
            foreign.spin_until(lambda: applied[-1].data[-3] < 20.0)  # 28 blocks later
            plant.resume()
            foreign.spin_until(lambda: applied[-1].data[-3] == 0.0)
        graph.interrupt()
        code, said = graph.wait()
    assert code == 0, said
    check_way_down(graph)
    check_stage_stayed_with(graph)


def test_a_second_sender_of_commands_is_a_fault(tmp_path: Path) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run", "--real-time") as graph:
        with ForeignNode(graph.domain) as foreign:
            reach_hold(graph, foreign)
            foreign.node.create_publisher(Float64MultiArray, "/stage/drive", QoSProfile(depth=10))
            foreign.spin_until(lambda: graph.process.poll() is not None)
        code, said = graph.wait()
    assert code == 1, said
    assert "2 publishers on the topic of the commands" in said
    check_way_down(graph)


@pytest.fixture
def amplifier(tmp_path: Path) -> Iterator[Amplifier]:
    with own_domain() as domain, ForeignNode(domain) as foreign:
        running = Amplifier(tmp_path, foreign, domain)
        try:
            yield running
        finally:
            running.close()


def test_a_fault_latches_until_it_is_reset(amplifier: Amplifier) -> None:
    spin = amplifier.foreign.spin_until
    assert amplifier.enable() == (True, "amplifier enabled")
    spin(lambda: len(amplifier.applied) == 1)
    for block in range(1, 6):
        amplifier.command(block, 50.0)
        spin(lambda block=block: len(amplifier.applied) == block + 1)
    assert amplifier.applied[-1].data[-3] == pytest.approx(50.0)
    amplifier.command(6, float("nan"))
    spin(lambda: amplifier.state().get("state") == "fault")
    spin(lambda: amplifier.applied[-1].data[-3] == 0.0)  # another topic than the state, so it may come later
    reason = "command voltage is not a finite number"
    assert amplifier.state()["reason"] == reason
    count = len(amplifier.applied)
    assert amplifier.enable() == (False, f"cannot enable: fault ({reason}); reset first")
    amplifier.command(count, 50.0)
    assert amplifier.call("reset", Trigger) == (True, "fault cleared; the amplifier is disabled")
    assert amplifier.call("reset", Trigger) == (False, "nothing to reset: the amplifier is disabled")
    assert len(amplifier.applied) == count, "nothing was put out in the fault"
    assert amplifier.enable() == (True, "amplifier enabled")
    spin(lambda: len(amplifier.applied) == count + 1)
    assert amplifier.call("discharge", Trigger)[0]
    spin(lambda: amplifier.state().get("state") == "disabled")
    amplifier.close()
    said = amplifier.log.read_text(encoding="utf-8")
    assert amplifier.process.returncode == 0, said
    for line in ("amplifier enabled", f"amplifier ramping: {reason}", f"amplifier fault: {reason}"):
        assert line in said
    assert "Traceback" not in said
