"""The conductor: waits for everybody, enables the stage, says `reference` block by block, and ends the run."""

from __future__ import annotations

import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from pzt_config.topics import TOPICS
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.join import Join
from pzt_nodes.messages import joint_state, status_of
from pzt_nodes.parameters import declare_text
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.reference import DISPLACEMENT, Reference
from pzt_ros.scenario import load_scenario

START_TIMEOUT = 30.0
"""If a node of the graph is not ready after this time [s], the run is given up."""


_DURATION = ParameterDescriptor(
    description="end the scenario after this time; 0 for its full length [s]",
    read_only=True,
    floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1e6, step=0.0)],
)


class ExperimentNode(GraphNode):
    """Runs one scenario. It asks the controller node to change controllers through its ROS parameter, and waits for the
    answer before it goes on, so that a change falls on the same block in every run."""

    def __init__(self) -> None:
        super().__init__("experiment")
        scenario = load_scenario(declare_text(self, "scenario", "scan", "scenario: shipped name or path"))
        self.experiment = scenario.experiment()
        self._end = float(self.declare_parameter("duration", 0.0, _DURATION).value) or math.inf
        self.axis = self.get_namespace().strip("/").replace("/", "_") or "stage"
        self._began = time.monotonic()
        self._state = "waiting"
        self._peers_ready: set[str] = set()
        self._enable = self.create_client(SetBool, "enable")
        self._set_parameters = self.create_client(SetParameters, "controller/set_parameters")
        self._join = Join(("measurement", "applied"), self._on_tick)
        for name in ("measurement", "applied"):
            self.listen(name, lambda block, name=name: self._join.add(self.tick_of(block), name, block))
        self.create_subscription(
            DiagnosticArray, "/diagnostics", self._on_diagnostics, self._qos(TOPICS["/diagnostics"])
        )
        self._timer = self.create_timer(0.02, self._try_start)

    # -- start

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for node, level, text, values in status_of(message):
            namespace, _, role = node.rpartition("/")
            if namespace != self.get_namespace().rstrip("/"):
                continue
            if values.get("ready") == "True":
                self._peers_ready.add(role)
            if role == "amplifier" and level == "error":
                self._give_up(f"the amplifier went to {text}")

    def _try_start(self) -> None:
        waiting = [node for node in self.peers if node not in self._peers_ready]
        services = self._enable.service_is_ready() and self._set_parameters.service_is_ready()
        if not waiting and services:
            self._timer.cancel()
            self._state = "running"
            self._enable.call_async(SetBool.Request(data=True)).add_done_callback(self._on_enabled)
        elif time.monotonic() - self._began > START_TIMEOUT:
            self._timer.cancel()
            self._give_up(f"not ready after {START_TIMEOUT:.0f} s: {', '.join(waiting) or 'services'}")

    def _on_enabled(self, future: Any) -> None:
        if not future.result().success:
            self._give_up(future.result().message)

    # -- run

    def _on_tick(self, tick: int, blocks: dict[str, Block]) -> None:
        if self._state != "running":
            return
        self.ticks += 1
        measurement = blocks["measurement"]
        reference = None
        if measurement.time[-1] < self._end:
            displacement, voltage = (
                float(measurement["displacement_m"].mean()),
                float(blocks["applied"]["voltage_V"][-1]),
            )
            reference = self.experiment.step(tick + 1, displacement, voltage)
        if reference is None:
            self._state = "finishing"
            self._enable.call_async(SetBool.Request(data=False)).add_done_callback(lambda _: self._watch_end())
        elif reference.controller:
            self._select(reference)
        else:
            self._say(reference)

    def _select(self, reference: Reference) -> None:
        """Change the controller, then say the reference: the graph waits for it meanwhile."""
        chosen = Parameter("controller", value=reference.controller).to_parameter_msg()

        def answered(future: Any) -> None:
            result = future.result().results[0]
            if result.successful:
                self._say(reference)
            else:
                self._give_up(f"controller '{reference.controller}' was refused: {result.reason}")

        self._set_parameters.call_async(SetParameters.Request(parameters=[chosen])).add_done_callback(answered)

    def _say(self, reference: Reference) -> None:
        name = "reference" if reference.quantity == DISPLACEMENT else "voltage_reference"
        self.publish(name, reference.time, reference.values)
        if reference.quantity == DISPLACEMENT:
            self.plot(
                "reference_joint_states",
                float(reference.time[-1]),
                lambda: joint_state(self.axis, reference.time, reference.values),
            )

    # -- end

    def _watch_end(self) -> None:
        self._state = "finished"
        self.finish(0)

    def _give_up(self, why: str) -> None:
        if self._state in ("given up", "finishing", "finished"):
            return
        self._state = "given up"
        self.get_logger().error(f"run given up: {why}")
        self.counts[f"run given up: {why}"] += 1
        self._report()
        self.finish(1)

    def health(self) -> tuple[str, str, dict[str, object]]:
        """How far the scenario is."""
        level, text, values = super().health()
        phase = self.experiment.phase
        values["phase"] = phase.kind if phase is not None else "over"
        values["run_time_s"] = round(self.ticks * self.block_size / self.sample_rate, 3)
        values["run_length_s"] = round(self.experiment.length, 3)
        return level, text if self._state in ("waiting", "running") else self._state, values


def main() -> None:
    """Run the experiment node."""
    run_node(ExperimentNode)


if __name__ == "__main__":
    main()
