"""The conductor: waits for everybody, says `reference` block by block, and ends the run.

Of a scenario it enables the stage itself; in manual operation it waits until somebody does.
"""

from __future__ import annotations

import math
import time
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from pzt_nodes.gate import Gate
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.join import Join
from pzt_nodes.messages import joint_state
from pzt_nodes.operator_desk import OperatorDesk
from pzt_nodes.parameters import declare_text
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.manual import conductor
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
        self.axis = self.get_namespace().strip("/").replace("/", "_") or "stage"
        self.manual = scenario.manual is not None
        self.conductor = conductor(scenario, self.axis)
        self._end = float(self.declare_parameter("duration", 0.0, _DURATION).value) or math.inf
        self._began = time.monotonic()
        self._state = "waiting"
        self._reported = ("", False, "")
        self._amplifier: dict[str, str] = {}
        self._peers_ready: set[str] = set()
        self._enable = self.create_client(SetBool, "enable")
        self._set_parameters = self.create_client(SetParameters, "controller/set_parameters")
        self._gate = Gate(self._answer)
        self._desk = OperatorDesk(self, self.conductor, self._gate)
        self._join = Join(("measurement", "applied"), self._on_tick)
        for name in ("measurement", "applied"):
            self.listen(name, lambda block, name=name: self._join.add(self.tick_of(block), name, block))
        self.listen_to_health(self._on_health)
        self._timer = self.create_timer(0.02, self._try_start)

    # -- start

    def _on_health(self, role: str, level: str, text: str, values: dict[str, str]) -> None:
        if values.get("ready") == "True":
            self._peers_ready.add(role)
        if role != "amplifier":
            return
        if self.manual:
            self._amplifier = values
            self._hear_amplifier()
        elif level == "error":
            self._give_up(f"the amplifier went to {text}")

    def _try_start(self) -> None:
        waiting = [node for node in self.peers if node not in self._peers_ready]
        services = self._enable.service_is_ready() and self._set_parameters.service_is_ready()
        if not waiting and services:
            self._timer.cancel()
            self._state = "running"
            if self.manual:
                self._wait_for_operator()
            else:
                self._enable.call_async(SetBool.Request(data=True)).add_done_callback(self._on_enabled)
        elif time.monotonic() - self._began > START_TIMEOUT:
            self._timer.cancel()
            self._give_up(f"not ready after {START_TIMEOUT:.0f} s: {', '.join(waiting) or 'services'}")

    def _wait_for_operator(self) -> None:
        """An operator's session ends on the wall clock: the run's own time stands still while nothing is enabled."""
        self.get_logger().info("waiting for an operator: call the service enable, then say joint_trajectory")
        self._hear_amplifier()
        if math.isfinite(self._end):
            self.create_timer(self._end, lambda: self.finish(0))

    def _hear_amplifier(self) -> None:
        """Ticks get through while the amplifier follows commands, once everybody is there to answer them."""
        if self._state == "running":
            self._gate.hear(self._amplifier)
            self._report_change()

    def _on_enabled(self, future: Any) -> None:
        if not future.result().success:
            self._give_up(future.result().message)

    # -- run

    def _on_tick(self, tick: int, blocks: dict[str, Block]) -> None:
        self.conductor.observe(blocks["applied"].time, blocks["applied"]["voltage_V"])
        if self.manual:
            self._gate.add(tick, blocks)
        elif self._state == "running":
            self._answer(tick, blocks)

    def _answer(self, tick: int, blocks: dict[str, Block]) -> None:
        """Say what is asked of the block that follows a tick."""
        self.ticks += 1
        measurement = blocks["measurement"]
        reference = None
        if self.manual or measurement.time[-1] < self._end:
            displacement, voltage = (
                float(measurement["displacement_m"].mean()),
                float(blocks["applied"]["voltage_V"][-1]),
            )
            reference = self.conductor.step(tick + 1, displacement, voltage)
            self._report_change()
        if reference is None:
            self._state = "finishing"
            self._enable.call_async(SetBool.Request(data=False)).add_done_callback(lambda _: self._watch_end())
        elif reference.controller:
            self._select(reference)
        else:
            self._say(reference)

    def _report_change(self) -> None:
        """Say at once what the stage is doing, when that is something else than before."""
        doing = (self.conductor.doing, self._gate.is_open, self._state)
        if doing != self._reported:
            self._reported = doing
            self._report()

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
        values["phase"] = "starting" if self._state == "waiting" else self.conductor.doing
        values["run_time_s"] = round(self.ticks * self.block_size / self.sample_rate, 3)
        values["run_length_s"] = round(self.conductor.length, 3)
        if self.manual and self._state != "waiting":
            values.update(self._desk.values())
        return level, text if self._state in ("waiting", "running") else self._state, values


def main() -> None:
    """Run the experiment node."""
    run_node(ExperimentNode)


if __name__ == "__main__":
    main()
