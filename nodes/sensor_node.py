"""The sensor driver: says `measurement`, the heartbeat of the graph."""

from __future__ import annotations

from pzt_nodes.managed_node import ManagedNode
from pzt_nodes.messages import joint_state
from pzt_nodes.parameters import declare_driver
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.errors import BenchError
from pzt_ros.hardware.driver import Bench
from pzt_ros.hardware.table import SENSORS, find_sensor


class SensorNode(ManagedNode):
    """A displacement sensor, chosen by the parameter `driver`; it is open while the node is configured.

    The simulated one reads the plant's `truth`. Every other is asked for a block when the amplifier says in `applied`
    that the block was put out; what it cannot read is not said, and the amplifier notices the silence.
    """

    def __init__(self) -> None:
        super().__init__("sensor")
        settings = declare_driver(self, SENSORS, find_sensor)
        self.driver = settings.build(Bench(self.load_plant(), self.rest, self.sample_rate, self.block_size))
        self._remark = ""
        self.axis = self.get_namespace().strip("/").replace("/", "_") or "stage"
        if settings.reads_truth:
            self.listen("truth", self._on_block)
        else:
            self.listen("applied", self._on_block)
        self.start()
        self._say_remark()

    # -- life cycle

    def configure(self) -> None:
        """Open the driver."""
        self.driver.open()
        self.driver.warm_up()

    def activate(self) -> None:
        """Nothing is asked of a sensor before its first block."""

    def unsafe(self) -> str:
        """A sensor is safe."""
        return ""

    def safe_within(self) -> float:
        """At once [s]."""
        return 0.0

    def cleanup(self) -> None:
        """Close the driver."""
        self.driver.close()

    # -- blocks

    def _on_block(self, block: Block) -> None:
        if self.inactive:
            self.counts["not measured while inactive"] += 1
            return
        truth = block["displacement_m"] if "displacement_m" in block.columns else block.time
        try:
            measurement = self.driver.read(block.time, truth)
        except BenchError as error:
            self.counts["sensor could not be read"] += 1
            if self.may_complain("sensor"):
                self.get_logger().error(str(error))
            return
        self.ticks += 1
        self.publish("measurement", block.time, measurement)
        self.plot("joint_states", float(block.time[-1]), lambda: joint_state(self.axis, block.time, measurement))
        self._say_remark()

    def _say_remark(self) -> None:
        if self.driver.remark != self._remark:
            self._remark = self.driver.remark
            self.get_logger().info(self._remark)

    def health(self) -> tuple[str, str, dict[str, object]]:
        """What the driver has to say."""
        level, text, values = super().health()
        return level, text, {**values, "remark": self.driver.remark} if self.driver.remark else values

    def close(self) -> None:
        """Let go of the instrument."""
        self.driver.close()
        super().close()


def main() -> None:
    """Run the sensor node."""
    run_node(SensorNode)


if __name__ == "__main__":
    main()
