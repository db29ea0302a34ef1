"""The amplifier driver: takes `drive`, says `applied`; the only node that moves the stage, and makes it safe."""

from __future__ import annotations

import time

from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from pzt_nodes.ears import Ears
from pzt_nodes.latency import LatencyLog
from pzt_nodes.managed_node import ManagedNode
from pzt_nodes.messages import float_message
from pzt_nodes.parameters import changed, declare_all, declare_driver, declare_rate, on_change
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import Block
from pzt_ros.errors import BenchError
from pzt_ros.hardware.amplifier import Applied
from pzt_ros.hardware.driver import Bench
from pzt_ros.hardware.guard import DISABLED, ENABLED, FAULT, RAMPING, GuardedAmplifier, Limits
from pzt_ros.hardware.table import AMPLIFIERS, find_amplifier
from pzt_ros.hardware.watch import Watch
from pzt_ros.scenario import REAL_TIME

LOOK_PERIOD, LOOK_BLOCKS = 0.02, 4
"""Senders and temperature are looked at this often [s]; measurement and estimate so, or after so many blocks: with
short blocks there would be more to read at once than a tick leaves time for."""
ON_ITS_WAY = 0.5
"""A command that comes so soon after commands are no longer followed was sent before its sender could know [s]."""


class AmplifierNode(ManagedNode):
    """A guarded amplifier behind topics and services; the instrument is chosen by the parameter `driver`.

    It is open while the node is configured, and may be enabled while it is active.

    Enabling puts out the first block, and with it the beat of a lock-step graph begins. The watchdog and the ramp to
    0 V run on the wall clock, in a simulation too: a tick that never comes must not leave 150 V on the stack.
    """

    def __init__(self) -> None:
        super().__init__("amplifier")
        settings = declare_driver(self, AMPLIFIERS, find_amplifier)
        limits = declare_all(self, "limits", Limits())
        self._paced = declare_rate(self) == REAL_TIME
        self._ages = LatencyLog()
        self.driver = settings.build(Bench(self.load_plant(), self.rest, self.sample_rate, self.block_size))
        self.amplifier = GuardedAmplifier(self.driver, limits, self.sample_rate, self.block_size, is_open=False)
        self.watch = Watch(self.amplifier, expects_sensor="sensor" in self.peers)
        self._shown = (DISABLED, "", "")
        self._enabled_at = 0
        self._left_enabled = -ON_ITS_WAY
        self._stopping = False
        self._ramp_due, self._watched = 0.0, 0.0
        self._ears = Ears(self, ("measurement", "estimate"))
        self.listen("drive", self._on_drive)
        self.create_service(SetBool, "enable", self._on_enable)
        self.create_service(Trigger, "reset", self._on_reset)
        self.create_service(Trigger, "discharge", self._on_discharge)
        self._block_period = self.block_size / self.sample_rate
        self.create_timer(self._block_period, self._watch)
        self._look_period = min(LOOK_PERIOD, LOOK_BLOCKS * self.block_size / self.sample_rate)
        self.create_timer(self._look_period, self._look)
        self.create_timer(LOOK_PERIOD, self._look_around)
        on_change(self, self._on_parameters)
        self.start()

    # -- life cycle

    def configure(self) -> None:
        """Open the driver; nothing is put out."""
        self.driver.open()
        try:
            self.amplifier.opened()
            self.amplifier.warm_up()
        except BenchError:
            self.driver.close()
            raise

    def activate(self) -> None:
        """See that the driver still knows the voltage at the stack."""
        self.amplifier.opened()

    def unsafe(self) -> str:
        """Ramp to 0 V, unless nothing is put out."""
        self.amplifier.disable()
        self._show_state()
        if self.amplifier.state in (DISABLED, FAULT):
            return ""
        return f"the amplifier is still {self.amplifier.state}: {self.amplifier.reason or 'on the way to 0 V'}"

    def safe_within(self) -> float:
        """The declared time of the ramp [s]."""
        return self.amplifier.limits.declared_safe_time

    def cleanup(self) -> None:
        """Close the driver."""
        self.driver.close()
        self.amplifier.closed()

    # -- blocks

    def _on_drive(self, block: Block) -> None:
        self._follow(block)
        self._keep_watch()

    def refuse(self, name: str, why: str) -> None:
        """Count a message that cannot be used, and keep watch meanwhile."""
        super().refuse(name, why)
        self._keep_watch()

    def _follow(self, block: Block) -> None:
        now = time.monotonic()
        age = self.watch.age(now)
        if self.amplifier.state == ENABLED:
            self._ages.add(age)
            if self._paced:
                self.watch.paced(age, self._block_period)
        elif now - self._left_enabled < ON_ITS_WAY:
            self.amplifier.counts["not followed: on its way when commands were followed no longer"] += 1
            return
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

    def _keep_watch(self) -> None:
        """The executor has its timers wait while messages come: a flood of them must not put the watchdog to sleep."""
        if time.monotonic() - self._watched > 2.0 * self._block_period:
            self._watch()

    def _watch(self) -> None:
        """Every block period on the wall clock: the watchdog, and the ramp to 0 V."""
        amplifier = self.amplifier
        now = self._watched = time.monotonic()
        if self.watch.unmeasured(now) > 2 * self._look_period:  # nobody is blamed for what has only not been looked at
            self._look()
        self.watch.look(now)
        if amplifier.state == RAMPING:
            self._ramp()
        else:
            self._ramp_due = 0.0
        self._show_state()
        if self._stopping and amplifier.state in (DISABLED, FAULT):
            self.finish()

    def _look(self) -> None:
        """What the sensor and the observer say."""
        for name, block in self._ears.take():
            if name == "measurement":
                self.watch.measured(block.first_time, block["displacement_m"])
            else:
                self.watch.estimated(block.first_time, block["innovation_m"])

    def _look_around(self) -> None:
        """Who sends commands, and how warm it is; both take long to ask."""
        self.watch.senders(self.count_publishers("drive"))
        if self.is_open:
            self.watch.temperature()

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
            self._ramp_due += self._block_period

    def _show_state(self) -> None:
        amplifier = self.amplifier
        now = (amplifier.state, amplifier.reason, self.driver.remark)
        if now == self._shown:
            return
        (state, reason, remark), (old_state, old_reason, old_remark) = now, self._shown
        self._shown = now
        if old_state == ENABLED != state:
            self._left_enabled = time.monotonic()
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
        elif self.inactive:
            response.success, response.message = False, f"cannot enable: {self.inactive}"
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
        self._enabled_at = self.amplifier.next_block
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
        if not self.inactive:
            self.amplifier.discharge()
        response.success, response.message = not self.inactive, self.inactive or f"amplifier {self.amplifier.state}"
        self._show_state()
        return response

    def _on_parameters(self, parameters: list[Parameter]) -> str:
        limits = changed(self.amplifier.limits, "limits", parameters)
        voltage = self.amplifier.stack_voltage
        if limits.voltage_min > voltage or voltage > limits.voltage_max:  # an unknown voltage forbids nothing
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
            "enabled_at_block": self._enabled_at,
            "stack_voltage_V": round(amplifier.stack_voltage, 6),
            "declared_safe_time_s": round(amplifier.limits.declared_safe_time, 3),
            **self._ages.summary("command_age"),
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
        if self.is_open:
            self.amplifier.discharge()
        self._show_state()

    def close(self) -> None:
        """Let go of the instrument."""
        self._ears.close()
        self.driver.close()
        super().close()


def main() -> None:
    """Run the amplifier node."""
    run_node(AmplifierNode)


if __name__ == "__main__":
    main()
