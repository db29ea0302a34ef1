"""Nodes in one process: the same nodes, quicker ticks, and one crash takes all with it.

`python -m pzt_nodes.composed [NODE...] [--ros-args ...]`: those that are named, or all.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from itertools import takewhile

from pzt_nodes.amplifier_node import AmplifierNode
from pzt_nodes.controller_node import ControllerNode
from pzt_nodes.experiment_node import ExperimentNode
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.intra_process import IntraProcess
from pzt_nodes.observer_node import ObserverNode
from pzt_nodes.plant_node import PlantNode
from pzt_nodes.recorder_node import RecorderNode
from pzt_nodes.sensor_node import SensorNode
from pzt_nodes.spin import run
from pzt_ros.errors import named
from pzt_ros.ros_environment import keep_apart

NODES: dict[str, Callable[[], GraphNode]] = {
    "recorder": RecorderNode,
    "amplifier": AmplifierNode,
    "plant": PlantNode,
    "sensor": SensorNode,
    "observer": ObserverNode,
    "controller": ControllerNode,
    "experiment": ExperimentNode,
}


def main() -> None:
    """Run the nodes in this process."""
    wanted = list(takewhile(lambda word: word != "--ros-args", sys.argv[1:])) or list(NODES)
    # the recorder reads from DDS when each message was sent and when it came
    if "recorder" not in wanted and keep_apart():
        GraphNode.intra_process = IntraProcess(GraphNode.turns)
    sys.exit(run([partial(_make, name) for name in wanted]))


def _make(name: str) -> GraphNode:
    return named(NODES, name, "node")()


if __name__ == "__main__":
    main()
