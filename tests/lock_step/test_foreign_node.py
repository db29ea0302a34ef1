"""The node of docs/foreign-node.md, as it stands there, beside a graph that waits for an operator."""

from __future__ import annotations

import ast
import os
import sys
from pathlib import Path

import numpy as np
from graph_process import GraphProcess, said_beside

from pzt_ros.bags.reader import open_bag

PROGRAM = Path(__file__).parents[2] / "docs" / "foreign_node.py"
POSITION = 3e-6


def test_it_imports_nothing_of_ours() -> None:
    found = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(PROGRAM.read_text(encoding="utf-8")))
        for name in ([a.name for a in node.names] if isinstance(node, ast.Import) else [getattr(node, "module", "")])
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    ros = {"rclpy", "builtin_interfaces", "diagnostic_msgs", "sensor_msgs", "std_msgs", "std_srvs", "trajectory_msgs"}
    assert found <= ros | set(sys.stdlib_module_names)


def test_it_drives_the_stage_reads_the_estimate_and_records_a_bag(tmp_path: Path) -> None:
    with GraphProcess("manual", tmp_path / "run") as graph:
        there = {**os.environ, "ROS_DOMAIN_ID": str(graph.domain)}
        found = said_beside(graph, [str(PROGRAM), "--position", str(POSITION)], there)
    bag = open_bag(tmp_path / "run" / "bag")
    assert bag.complete
    estimate, truth = bag.blocks("/stage/estimate"), bag.blocks("/stage/truth")
    assert found["blocks"] > 100
    assert found["there_m"] in estimate["displacement_m"], "what it heard is what was recorded"
    assert abs(found["there_m"] - POSITION) < 0.3e-6
    assert np.abs(truth["displacement_m"] - POSITION).min() < 0.1e-6, "the stage was there"
    assert bag.blocks("/stage/applied")["voltage_V"][-1] == 0.0
