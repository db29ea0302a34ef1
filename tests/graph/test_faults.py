"""A node is killed, Ctrl-C is pressed, the supervisor is killed: the stage goes to 0 V and nothing is left."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import psutil
import pytest
from foreign_node import ForeignNode
from graph_process import GraphProcess, alive, wait_until
from scenarios import LONG_HOLD, write
from std_msgs.msg import Float64MultiArray

from pzt_config.topics import NODES
from pzt_ros.bags.reader import open_bag
from pzt_ros.hardware.guard import Limits


def wait_for_voltage(graph: GraphProcess) -> list[psutil.Process]:
    """Until there have been 100 V on the stack for 0.4 s; returns the processes of the graph."""
    with ForeignNode(graph.domain) as foreign:
        foreign.listen("/stage/applied", Float64MultiArray)
        applied = foreign.heard["/stage/applied"]
        foreign.spin_until(lambda: bool(applied) and applied[-1].data[-4] > 0.6 and applied[-1].data[-3] > 99.0)
    return graph.nodes()


@pytest.mark.parametrize("victim", [node for node in NODES if node != "experiment"])
def test_killed_node_brings_the_stage_to_safety(tmp_path: Path, victim: str) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run", "--real-time") as graph:
        processes = wait_for_voltage(graph)
        graph.node(victim).send_signal(signal.SIGKILL)
        code, said = graph.wait()
    assert code == 1
    how = "relay discharged the stack" if victim == "amplifier" else "the amplifier brought the stack to 0 V"
    assert f"'{victim}' died (killed by SIGKILL); the amplifier" in said.strip().splitlines()[-1]
    assert how in said
    assert alive(processes) == []
    status = graph.run_json()["outcome"]["status"]
    holder = "plant" if victim == "amplifier" else "amplifier"
    assert status[holder]["stack_voltage_V"] == 0.0
    check_bag(graph, victim)


def check_bag(graph: GraphProcess, victim: str) -> None:
    """The bag is readable; unless the recorder was the victim, it shows the way to 0 V within the declared time."""
    bag = open_bag(graph.folder / "bag")
    assert bag.complete == (victim != "recorder")
    applied = bag.blocks("/stage/applied")
    assert applied["voltage_V"].max() > 80.0  # a killed recorder loses its last 0.1 s
    if victim in ("recorder", "amplifier"):
        return
    assert applied["voltage_V"][-1] == 0.0
    step = np.abs(np.diff(applied["voltage_V"]))
    assert step.max() <= Limits().slew_rate / 20e3 * (1 + 1e-9)
    last_command = max(when for when, _ in bag.messages("/stage/drive"))
    at_zero = [
        when for when, message in bag.messages("/stage/applied") if message.data[-3] == 0.0 and when > last_command
    ]
    assert (at_zero[0] - last_command) * 1e-9 <= Limits().declared_safe_time


def test_ctrl_c_ends_cleanly(tmp_path: Path) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run") as graph:
        processes = wait_for_voltage(graph)
        graph.interrupt()
        code, said = graph.wait()
    assert code == 0, said
    assert "Traceback" not in said
    assert alive(processes) == []
    bag = open_bag(graph.folder / "bag")
    assert bag.complete
    assert bag.blocks("/stage/applied")["voltage_V"][-1] == 0.0
    for log in (graph.folder / "log").glob("*.log"):
        assert "Traceback" not in log.read_text(encoding="utf-8"), log


def test_killed_supervisor_leaves_no_orphans(tmp_path: Path) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run") as graph:
        processes = wait_for_voltage(graph)
        os.kill(graph.process.pid, signal.SIGKILL)
        wait_until(lambda: not alive(processes), "nodes of a killed supervisor are still there", patience=20.0)
    assert "amplifier disabled" in (graph.folder / "log" / "amplifier.log").read_text(encoding="utf-8")
    assert open_bag(graph.folder / "bag").complete


def test_killed_composed_graph_does_not_claim_to_be_safe(tmp_path: Path) -> None:
    with GraphProcess(write(tmp_path, LONG_HOLD), tmp_path / "run", "--composed") as graph:
        processes = wait_for_voltage(graph)
        graph.node("composed").send_signal(signal.SIGKILL)
        code, said = graph.wait()
    assert code == 1
    assert "nobody is left who knows the voltage of the stack" in said
    assert alive(processes) == []
    bag = open_bag(graph.folder / "bag")
    assert not bag.complete
    assert bag.blocks("/stage/applied")["voltage_V"].max() > 80.0
