"""The amplifier driver: takes `drive`, says `applied`; the only node that moves the stage, and makes it safe."""

from __future__ import annotations

import time

from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from pzt_nodes.ears import Ears
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import float_message
from pzt_nodes.parameters import changed, declare_all, declare_driver, on_change
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.errors import BenchError
from pzt_ros.hardware.amplifier import Applied
from pzt_ros.hardware.driver import Bench
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits
from pzt_ros.hardware.table import AMPLIFIERS, find_amplifier
from pzt_ros.hardware.watch import Watch

LOOK_PERIOD = 0.02
"""Measurement, estimate and the number of senders are looked at this often [s]."""


class AmplifierNode(GraphNode):
    """A guarded amplifier behind topics and services; the instrument is chosen by the parameter `driver`.

    Enabling puts out the first block, and with it the beat of a lock-step graph begins. The watchdog and the ramp to
    0 V run on the wall clock, in a simulation too: a tick that never comes must not leave 150 V on the stack.
    """

    def __init__(self) -> None:
        super().__init__("amplifier")
        settings = declare_driver(self, AMPLIFIERS, find_amplifier)
        limits = declare_all(self, "limits", Limits())
        self.driver = settings.build(Bench(self.load_plant(), self.rest, self.sample_rate, self.block_size))
        self.driver.open()
        self.amplifier = GuardedAmplifier(self.driver, limits, self.sample_rate, self.block_size)
        self.amplifier.warm_up()
        self.watch = Watch(self.amplifier, expects_sensor="sensor" in self.peers)
        self._shown = (DISABLED, "", "")
        self._stopping = False
        self._ramp_due = 0.0
        self._ears = Ears(self, ("measurement", "estimate"))
        self.listen("drive", self._on_drive)
        self.create_service(SetBool, "enable", self._on_enable)
        self.create_service(Trigger, "reset", self._on_reset)
        self.create_service(Trigger, "discharge", self._on_discharge)
        self.create_timer(self.block_size / self.sample_rate, self._watch)
        self.create_timer(LOOK_PERIOD, self._look)
        on_change(self, self._on_parameters)

    # -- blocks

    def _on_drive(self, block: Block) -> None:
        age = self.watch.age(time.monotonic())
        applied = self.amplifier.apply(block.first_time, block["command_voltage_V"], age)
        if applied is None:
            self.refuse("drive", "; ".join(f"{what} ({n})" for what, n in self.amplifier.counts.items()))
        else:
            self.watch.put_out(applied, time.monotonic())
            self._publish(applied)
        self._show_state()

    def _publish(self, applied: Applied) -> None:
        self.ticks += 1
        self.publish("applied", applied.time, applied.voltage, applied.current, applied.charge)
        self.plot("voltage", float(applied.time[-1]), lambda: float_message(applied.voltage[-1]))

    # -- what goes on beside the blocks

    def _watch(self) -> None:
        """Every block period on the wall clock: the watchdog, and the ramp to 0 V."""
        amplifier = self.amplifier
        self.watch.look(time.monotonic())
        if amplifier.state == RAMPING:
            self._ramp()
        else:
            self._ramp_due = 0.0
        self._show_state()
        if self._stopping and amplifier.state in (DISABLED, FAULT):
            self.finish()

    def _look(self) -> None:
        """What the sensor and the observer say, and who sends commands."""
        for name, block in self._ears.take():
            if name == "measurement":
                self.watch.measured(block.first_time, block["displacement_m"])
            else:
                self.watch.estimated(block["innovation_m"])
        self.watch.senders(self.count_publishers("drive"))

    def _ramp(self) -> None:
        """As many blocks of the ramp as the wall clock asks for: a timer that comes late must not stretch it."""
        now = time.monotonic()
        self._ramp_due = self._ramp_due or now
        while self._ramp_due <= now and self.amplifier.state == RAMPING:
            applied = self.amplifier.ramp()
            if applied is None:  # the driver failed; it is asked again in the next period
                self._ramp_due = 0.0
                return
            self._publish(applied)
            self._ramp_due += self.block_size / self.sample_rate

    def _show_state(self) -> None:
        amplifier = self.amplifier
        now = (amplifier.state, amplifier.reason, self.driver.remark)
        if now == self._shown:
            return
        (state, reason, remark), (old_state, old_reason, old_remark) = now, self._shown
        self._shown = now
        if (state, reason) == (old_state, old_reason):
            pass
        elif reason:  # rclpy takes one severity per line of code, and raises at the second
            self.get_logger().error(f"amplifier {state}: {reason}")
        else:
            self.get_logger().info(f"amplifier {state}")
        if remark != old_remark:
            self.get_logger().info(remark)
        self._report()

    # -- services and parameters

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not request.data:
            self.amplifier.disable()
            response.success, response.message = True, f"amplifier {self.amplifier.state}"
        elif self.amplifier.state == ENABLED:
            response.success, response.message = True, "amplifier is enabled already"
        else:
            problem = self.amplifier.enable() or self._begin()
            response.success, response.message = not problem, problem or "amplifier enabled"
        self._show_state()
        return response

    def _begin(self) -> str:
        """Put out the first block, the voltage found; what is in the way, or nothing."""
        self.watch.restart(time.monotonic())
        try:
            applied = self.amplifier.hold()
        except BenchError as error:
            return f"cannot enable: {error}"
        self.watch.put_out(applied, time.monotonic())
        self._publish(applied)
        return ""

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self.amplifier.reset()
        response.success, response.message = not problem, problem or "fault cleared; the amplifier is disabled"
        self._show_state()
        return response

    def _on_discharge(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.amplifier.discharge()
        response.success, response.message = True, f"amplifier {self.amplifier.state}"
        self._show_state()
        return response

    def _on_parameters(self, parameters: list[Parameter]) -> str:
        limits = changed(self.amplifier.limits, "limits", parameters)
        voltage = self.amplifier.stack_voltage
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
            "stack_voltage_V": round(amplifier.stack_voltage, 6),
            "declared_safe_time_s": round(amplifier.limits.declared_safe_time, 3),
        }
        if self.driver.remark:
            values["remark"] = self.driver.remark
        if amplifier.reason:
            return "error", f"{amplifier.state}: {amplifier.reason}", values
        return level, text, values

    # -- the end

    def stop(self) -> None:
        """To 0 V first, then out."""
        self._stopping = True
        self.amplifier.discharge()
        self._show_state()

    def close(self) -> None:
        """Let go of the instrument."""
        self._ears.close()
        self.driver.close()


def main() -> None:
    """Run the amplifier node."""
    run_node(AmplifierNode)


if __name__ == "__main__":
    main()
