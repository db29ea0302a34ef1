"""The sensor driver: says `measurement`, the heartbeat of the graph."""

from __future__ import annotations

from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import joint_state
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.hardware.stage import SimulatedSensor


class SensorNode(GraphNode):
    """A displacement sensor; the simulated one reads the plant's `truth`."""

    def __init__(self) -> None:
        super().__init__("sensor")
        chain = self.load_plant()
        self.sensor = SimulatedSensor(chain, self.rest)
        self.sensor.warm_up()
        self.axis = self.get_namespace().strip("/").replace("/", "_") or "stage"
        self.listen("truth", self._on_truth)

    def _on_truth(self, block: Block) -> None:
        self.ticks += 1
        measurement = self.sensor.read(block.time, block["displacement_m"])
        self.publish("measurement", block.time, measurement)
        self.plot("joint_states", float(block.time[-1]), lambda: joint_state(self.axis, block.time, measurement))


def main() -> None:
    """Run the sensor node."""
    run_node(SensorNode)


if __name__ == "__main__":
    main()
