"""All nodes in one process: the same nodes, ticks twenty times as fast, and one crash takes all with it."""

from __future__ import annotations

import sys

from pzt_nodes.amplifier_node import AmplifierNode
from pzt_nodes.controller_node import ControllerNode
from pzt_nodes.experiment_node import ExperimentNode
from pzt_nodes.observer_node import ObserverNode
from pzt_nodes.plant_node import PlantNode
from pzt_nodes.recorder_node import RecorderNode
from pzt_nodes.sensor_node import SensorNode
from pzt_nodes.spin import run

COMPOSED = (RecorderNode, AmplifierNode, PlantNode, SensorNode, ObserverNode, ControllerNode, ExperimentNode)


def main() -> None:
    """Run the whole graph in this process."""
    sys.exit(run(COMPOSED))


if __name__ == "__main__":
    main()
