"""Another DDS vendor on the same wire: Eclipse Cyclone DDS enables the stage, moves it, and reads its joint states."""

from __future__ import annotations

import importlib.util
import itertools
import os
from pathlib import Path

import numpy as np
import pytest
from graph_process import GraphProcess, said_beside, wait_until

from pzt_ros.bags.reader import open_bag

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None, reason="cyclonedds has no wheel for this Python"
)

POSITION = 3e-6


def test_cyclone_enables_moves_and_reads_the_stage(tmp_path: Path) -> None:
    with GraphProcess("manual", tmp_path / "run") as graph:
        log = tmp_path / "run" / "log" / "experiment.log"
        wait_until(lambda: log.exists() and "waiting for an operator" in log.read_text(encoding="utf-8"), "a graph")
        peer = Path(__file__).with_name("cyclone_peer.py")
        ros_left_out = {k: v for k, v in os.environ.items() if not k.startswith(("ROS_", "RMW_", "FASTRTPS_"))}
        heard = said_beside(graph, [str(peer), str(graph.domain), str(POSITION)], ros_left_out)
    assert heard["name"] == ["stage"]
    assert heard["count"] > 20
    assert min(b - a for a, b in itertools.pairwise(heard["stamps"])) >= 0.01 - 1e-6, "at most 100 Hz"
    bag = open_bag(tmp_path / "run" / "bag")
    asked, measured = bag.blocks("/stage/reference"), bag.blocks("/stage/measurement")
    assert abs(asked["displacement_m"].max() - POSITION) < 1e-12, "the trajectory was followed"
    assert np.abs(measured["displacement_m"] - POSITION).min() < 0.2e-6
    states = {round(m.header.stamp.sec * 1e9 + m.header.stamp.nanosec): m.position[0] for _, m in
              bag.messages("/stage/joint_states")}  # fmt: skip
    assert states[round(1e9 * heard["stamps"][-1])] == heard["position"], "the same number as the recorder heard"
