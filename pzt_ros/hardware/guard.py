"""Between a bug and 150 V stands this: everything the amplifier is asked to do passes here first.

It checks every block and trusts nobody. What cannot be (not a number, another shape, out of turn) is refused; what is
too much (outside the window, too fast) is limited and counted; what is dangerous (too much current, silence,
not-a-number) is a fault: the voltage is ramped to 0 V at the safe rate, and the fault stays until it is reset.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numba import njit

from pzt_ros.hardware.amplifier import AmplifierDriver, Applied
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter
from pzt_ros.reference import block_times

DISABLED, ENABLED, RAMPING, FAULT = "disabled", "enabled", "ramping", "fault"


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What the stack and the amplifier stand (thesis 2.1: used from -40 to 150 V, amplifier 200 mA)."""

    voltage_min: float = parameter(-40.0, "V", "lowest voltage across the stack", bounds=(-200.0, 0.0))
    voltage_max: float = parameter(150.0, "V", "highest voltage across the stack", bounds=(0.0, 200.0))
    slew_rate: float = parameter(2e5, "V/s", "fastest change of the voltage", bounds=(1.0, 5e8))
    current: float = parameter(0.2, "A", "largest current into the stack", bounds=(1e-6, 10.0))
    safe_rate: float = parameter(500.0, "V/s", "rate of the ramp to 0 V that makes the stage safe", bounds=(1.0, 1e5))
    command_timeout: float = parameter(
        0.5, "s", "silence of the commands, on the wall clock, before the stage is made safe", bounds=(0.005, 60.0)
    )

    @property
    def ramp_rate(self) -> float:
        """Rate of the ramp to 0 V [V/s]: the safe rate, unless even that is too fast."""
        return min(self.safe_rate, self.slew_rate)

    @property
    def declared_safe_time(self) -> float:
        """Within this wall-clock time after the last command the stack is at 0 V [s]; 0.2 s are for the machine."""
        return self.command_timeout + max(-self.voltage_min, self.voltage_max) / self.ramp_rate + 0.2


class GuardedAmplifier:
    """An amplifier driver behind its guards, as a machine of four states.

    disabled: 0 V whatever is asked. enabled: follows the commands. ramping: on the way to 0 V, commands are ignored.
    fault: at 0 V with a reason, until `reset`. The limits are the stack's; a command is smaller by the driver's gain.
    """

    def __init__(self, driver: AmplifierDriver, limits: Limits, sample_rate: float, block_size: int) -> None:
        self.driver = driver
        self.limits = limits
        self.sample_rate = sample_rate
        self.block_size = block_size
        self.state = DISABLED
        self.reason = ""
        self.counts: Counter[str] = Counter()
        self._command = driver.voltage / driver.gain
        self._next = 0

    def warm_up(self) -> None:
        """Compile now what the first command would have to wait for."""
        _limit(np.zeros(2), 0.0, 0.0, 0.0, 1.0)
        self.driver.warm_up()

    @property
    def next_block(self) -> int:
        """Number of the block that comes next."""
        return self._next

    @property
    def command_voltage(self) -> float:
        """The last command put out [V]."""
        return self._command

    def enable(self) -> str:
        """Follow commands from now on; returns what is in the way, or nothing."""
        if self.state == RAMPING:
            return f"cannot enable: ramping to 0 V{f' ({self.reason})' if self.reason else ''}; wait until it is there"
        if self.state == FAULT:
            return f"cannot enable: fault ({self.reason}); reset first"
        self.state = ENABLED
        return ""

    def disable(self) -> None:
        """Ramp to 0 V and ignore commands."""
        if self.state == ENABLED:
            self.state = RAMPING if self._command != 0.0 else DISABLED

    def reset(self) -> str:
        """Leave the fault; returns what is in the way, or nothing."""
        if self.state != FAULT:
            return f"nothing to reset: the amplifier is {self.state}"
        self.state, self.reason = DISABLED, ""
        return ""

    def fault(self, reason: str) -> None:
        """Something is wrong: ramp to 0 V and stay there. The first reason is the one that is kept."""
        if self.state == FAULT or (self.state == RAMPING and self.reason):
            return
        self.reason = reason
        self.state = RAMPING if self._command != 0.0 else FAULT

    def apply(self, first_time: float, command_voltage: Array) -> Applied | None:
        """Put out a block of command voltage [V] that starts at `first_time` [s]; None if it was refused."""
        if self.state != ENABLED:
            self.counts[f"refused: amplifier is {self.state}"] += 1
            return None
        if command_voltage.shape != (self.block_size,):
            self.counts["refused: wrong block size"] += 1
            return None
        if not abs(first_time * self.sample_rate - self._next * self.block_size) < 0.5:  # refuses a time of NaN, too
            self.counts["refused: out of turn"] += 1
            return None
        if not np.all(np.isfinite(command_voltage)):
            self.counts["refused: not finite"] += 1
            self.fault("command voltage is not a finite number")
            return None
        return self._put_out(self._limited(command_voltage))

    def hold(self) -> Applied:
        """Put out one more block of the last command."""
        return self._put_out(np.full(self.block_size, self._command))

    def ramp(self) -> Applied:
        """Put out the next block of the way to 0 V, or of staying there."""
        step = self.limits.ramp_rate / self.driver.gain / self.sample_rate
        count = np.arange(1, self.block_size + 1)
        command = np.sign(self._command) * np.maximum(np.abs(self._command) - step * count, 0.0)
        applied = self._put_out(command)
        if self.state == RAMPING and self._command == 0.0:
            self.state = FAULT if self.reason else DISABLED
        return applied

    def _limited(self, wanted: Array) -> Array:
        limits, gain = self.limits, self.driver.gain
        step = limits.slew_rate / gain / self.sample_rate
        command, outside, fast = _limit(
            wanted, self._command, limits.voltage_min / gain, limits.voltage_max / gain, step
        )
        self.counts["limited: voltage window"] += outside
        self.counts["limited: slew rate"] += fast
        return command

    def _put_out(self, command: Array) -> Applied:
        time = block_times(self._next, self.block_size, self.sample_rate)
        applied = self.driver.apply(time, command)
        self._next += 1
        self._command = float(command[-1])
        peak = float(np.max(np.abs(applied.current)))
        if self.state == ENABLED and not peak <= self.limits.current:  # so a current of NaN is a fault
            self.fault(f"current of {1e3 * peak:.1f} mA exceeds the limit of {1e3 * self.limits.current:.1f} mA")
        return applied


@njit(cache=True)
def _limit(wanted: Array, last: float, lowest: float, highest: float, step: float) -> tuple[Array, int, int]:
    """Follow `wanted` inside the window and by at most `step` a sample, from `last`.

    Returns:
        the command, how many samples were outside the window, and how many were held back by the slew rate.
    """
    out = np.empty_like(wanted)
    outside, fast = 0, 0
    for i in range(len(wanted)):
        inside = min(max(wanted[i], lowest), highest)
        outside += inside != wanted[i]
        change = inside - last
        if abs(change) > step:
            change = step if change > 0.0 else -step
            fast += 1
            last += change
        else:
            last = inside
        out[i] = last
    return out, outside, fast
