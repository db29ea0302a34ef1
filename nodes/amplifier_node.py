"""The amplifier driver: takes `drive`, says `applied`; the only node that moves the stage, and makes it safe."""

from __future__ import annotations

import time

from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import float_message
from pzt_nodes.parameters import changed, declare_all, on_change
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.hardware.amplifier import Applied, SimulatedAmplifier
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits


class AmplifierNode(GraphNode):
    """A guarded amplifier behind topics and services.

    Enabling puts out the first block, and with it the beat of a lock-step graph begins. The watchdog and the ramp to
    0 V run on the wall clock, in a simulation too: a tick that never comes must not leave 150 V on the stack.
    """

    def __init__(self) -> None:
        super().__init__("amplifier")
        chain = self.load_plant()
        limits = declare_all(self, "limits", Limits())
        driver = SimulatedAmplifier(chain, self.rest)
        self.amplifier = GuardedAmplifier(driver, limits, self.sample_rate, self.block_size)
        self.amplifier.warm_up()
        self._last_command = time.monotonic()
        self._shown_state = DISABLED
        self._stopping = False
        self._ramp_due = 0.0
        self.listen("drive", self._on_drive)
        self.create_service(SetBool, "enable", self._on_enable)
        self.create_service(Trigger, "reset", self._on_reset)
        self.create_service(Trigger, "discharge", self._on_discharge)
        self.create_timer(self.block_size / self.sample_rate, self._watch)
        on_change(self, self._on_parameters)

    def _on_drive(self, block: Block) -> None:
        applied = self.amplifier.apply(block.first_time, block["command_voltage_V"])
        if applied is None:
            self.refuse("drive", "; ".join(f"{what} ({n})" for what, n in self.amplifier.counts.items()))
        else:
            self._last_command = time.monotonic()
            self._publish(applied)
        self._show_state()

    def _publish(self, applied: Applied) -> None:
        self.ticks += 1
        self.publish("applied", applied.time, applied.voltage, applied.current, applied.charge)
        self.plot("voltage", float(applied.time[-1]), lambda: float_message(applied.voltage[-1]))

    def _watch(self) -> None:
        """Every block period on the wall clock: the watchdog, and the ramp to 0 V."""
        amplifier = self.amplifier
        silence = time.monotonic() - self._last_command
        if amplifier.state == ENABLED and silence > amplifier.limits.command_timeout:
            amplifier.fault(f"no command for {silence:.2f} s, limit {amplifier.limits.command_timeout:.2f} s")
        if amplifier.state == RAMPING:
            self._ramp()
        else:
            self._ramp_due = 0.0
        self._show_state()
        if self._stopping and amplifier.state in (DISABLED, FAULT):
            self.finish()

    def _ramp(self) -> None:
        """As many blocks of the ramp as the wall clock asks for: a timer that comes late must not stretch it."""
        now = time.monotonic()
        self._ramp_due = self._ramp_due or now
        while self._ramp_due <= now and self.amplifier.state == RAMPING:
            self._publish(self.amplifier.ramp())
            self._ramp_due += self.block_size / self.sample_rate

    def _show_state(self) -> None:
        state = self.amplifier.state
        if state != self._shown_state:
            self._shown_state = state
            reason = self.amplifier.reason
            log = self.get_logger().error if reason else self.get_logger().info
            log(f"amplifier {state}" + (f": {reason}" if reason else ""))
            self._report()

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not request.data:
            self.amplifier.disable()
            response.success, response.message = True, f"amplifier {self.amplifier.state}"
        elif self.amplifier.state == ENABLED:
            response.success, response.message = True, "amplifier is enabled already"
        else:
            problem = self.amplifier.enable()
            response.success, response.message = not problem, problem or "amplifier enabled"
            if not problem:
                self._last_command = time.monotonic()
                self._publish(self.amplifier.hold())
        self._show_state()
        return response

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.amplifier.reset()
        response.success, response.message = not problem, problem or "fault cleared; the amplifier is disabled"
        self._show_state()
        return response

    def _on_discharge(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.amplifier.disable()
        response.success, response.message = True, f"amplifier {self.amplifier.state}"
        self._show_state()
        return response

    def _on_parameters(self, parameters: list[Parameter]) -> str:
        limits = changed(self.amplifier.limits, "limits", parameters)
        voltage = self.amplifier.driver.voltage
        if not limits.voltage_min <= voltage <= limits.voltage_max:
            return f"the stack is at {voltage:.2f} V, outside that window; move it first"
        self.amplifier.limits = limits
        return ""

    def health(self) -> tuple[str, str, dict[str, object]]:
        """The machine's state, its reason, and the voltage at the stack."""
        level, text, values = super().health()
        amplifier = self.amplifier
        values = {
            **values,
            **{key: count for key, count in amplifier.counts.items() if count},
            "state": amplifier.state,
            "reason": amplifier.reason,
            "stack_voltage_V": round(amplifier.driver.voltage, 6),
            "declared_safe_time_s": round(amplifier.limits.declared_safe_time, 3),
        }
        if amplifier.reason:
            return "error", f"{amplifier.state}: {amplifier.reason}", values
        return level, text, values

    def stop(self) -> None:
        """To 0 V first, then out."""
        self._stopping = True
        self.amplifier.disable()
        self._show_state()


def main() -> None:
    """Run the amplifier node."""
    run_node(AmplifierNode)


if __name__ == "__main__":
    main()
