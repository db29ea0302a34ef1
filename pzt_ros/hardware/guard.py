"""Between a bug and 150 V stands this: everything the amplifier is asked to do passes here first.

It checks every block and trusts nobody. What cannot be (another shape, out of turn) is refused; what is too much
(outside the window, too fast) is limited and counted; what is dangerous (too much current or power, silence, not a
number, a driver that fails) is a fault: the voltage is ramped to 0 V at the safe rate, and the fault stays until it is
reset. Which event leads where is the table in `machine.py`.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numba import njit

from pzt_ros.errors import BenchError
from pzt_ros.hardware import block_figures, machine
from pzt_ros.hardware.amplifier import AmplifierDriver, Applied
from pzt_ros.hardware.limits import Limits
from pzt_ros.hardware.machine import DISABLED, ENABLED, FAULT, RAMPING, TRIPPED, SafetyMachine
from pzt_ros.physics.signals import Array
from pzt_ros.reference import block_times

__all__ = ["DISABLED", "ENABLED", "FAULT", "RAMPING", "GuardedAmplifier", "Limits"]


class GuardedAmplifier:
    """An amplifier driver behind its guards.

    The limits are the stack's; a command is smaller by the driver's gain. Enabling and ramping start at the voltage
    that is found at the stack then, so neither makes the stage jump.
    """

    def __init__(
        self, driver: AmplifierDriver, limits: Limits, sample_rate: float, block_size: int, is_open: bool = True
    ) -> None:
        self.driver = driver
        self.limits = limits
        self.sample_rate = sample_rate
        self.block_size = block_size
        self.counts: Counter[str] = Counter()
        self._machine = SafetyMachine()
        self._present: dict[str, str] = {}
        self._voltage = math.nan
        self._command = math.nan
        self._ceiling = math.inf  # no more than this can have been put out, up or down
        self._next = 0
        self._lost = True
        if is_open:
            self._find()

    def warm_up(self) -> None:
        """Compile now what the first command would have to wait for."""
        _limit(np.zeros(2), 0.0, 0.0, 0.0, 1.0)
        block_figures.warm_up()
        self.driver.warm_up()

    def opened(self) -> None:
        """The driver was opened.

        Raises:
            BenchError: it cannot say the voltage at the stack.
        """
        found = self.driver.voltage
        if not math.isfinite(found):
            raise BenchError(f"the driver found {found} V at the stack; look at the amplifier")
        self._find(at_rest=True)

    def closed(self) -> None:
        """The driver was closed: nobody knows the voltage any more."""
        self._lost = True

    @property
    def state(self) -> str:
        """disabled, enabled, ramping or fault."""
        return self._machine.shown

    @property
    def reason(self) -> str:
        """Of the fault, or empty."""
        return self._machine.reason

    @property
    def next_block(self) -> int:
        """Number of the block that comes next."""
        return self._next

    @property
    def command_voltage(self) -> float:
        """The last command put out, or the one that holds the voltage found [V]."""
        return self._command

    @property
    def stack_voltage(self) -> float:
        """Voltage at the stack as far as it is known [V]; NaN while the driver cannot say."""
        return math.nan if self._lost else self._voltage

    # -- what is asked

    def enable(self) -> str:
        """Follow commands from now on; returns what is in the way, or nothing."""
        cause = self._cause_present()
        if self._machine.state == DISABLED and not cause:
            cause = self._cannot_start()
        return self._machine.handle(machine.ENABLE_EARLY if cause else machine.ENABLE, cause)

    def disable(self) -> None:
        """Ramp to 0 V and ignore commands; a disabled amplifier is left as it is."""
        self._machine.handle(machine.DISABLE)
        self._settle()

    def discharge(self) -> None:
        """Ramp to 0 V from wherever the stack is."""
        if self._machine.state == DISABLED:
            self._find(at_rest=True)
        self._machine.handle(machine.DISCHARGE)
        self._settle()

    def reset(self) -> str:
        """Leave the fault, once its cause is gone; returns what is in the way, or nothing."""
        cause = self._cause_present()
        return self._machine.handle(machine.RESET_EARLY if cause else machine.RESET, cause)

    # -- what goes wrong

    def fault(self, reason: str) -> None:
        """Something is wrong: ramp to 0 V and stay there. The first reason is the one that is kept."""
        self.trip(machine.ASKED_FAULT, reason)

    def trip(self, cause: str, reason: str) -> None:
        """One of the causes of the table has come up."""
        at_rest = self._machine.state == DISABLED
        self._machine.handle(cause, reason)
        if at_rest and self._machine.state == TRIPPED:
            self._find(at_rest)
        self._settle()

    def present(self, cause: str, reason: str) -> None:
        """A cause that lasts: it trips, and until it is said to be gone (no reason) nothing is enabled or reset."""
        if reason:
            self._present[cause] = reason
            self.trip(cause, reason)
        else:
            self._present.pop(cause, None)

    # -- blocks

    def apply(self, first_time: float, command_voltage: Array, age: float = 0.0) -> Applied | None:
        """Put out a block of command voltage [V] that starts at `first_time` [s]; None if it was refused.

        `age` is the wall-clock time since the block before was put out [s].
        """
        refused = self._machine.handle(machine.COMMAND) or self._unfit(first_time, command_voltage)
        if refused:
            self.counts[f"refused: {refused}"] += 1
            return None
        if not np.isfinite(command_voltage).all():
            self.counts["refused: not finite"] += 1
            self.trip(machine.NOT_FINITE, "command voltage is not a finite number")
            return None
        if not age <= self.limits.oldest_command:
            self.counts["refused: too old"] += 1
            self.trip(machine.TOO_OLD, f"command is {age:.2f} s old, limit {self.limits.oldest_command:.2f} s")
            return None
        return self._attempt(self._limited(command_voltage))

    def hold(self) -> Applied:
        """Put out one more block of the last command.

        Raises:
            BenchError: the driver failed; that is a fault already.
        """
        return self._put_out(np.full(self.block_size, self._command))

    def ramp(self) -> Applied | None:
        """Put out the next block of the way to 0 V, or of staying there; None if the driver cannot."""
        if self._lost and not self._find():
            return None
        step = self.limits.ramp_rate / self.driver.gain / self.sample_rate
        count = np.arange(1, self.block_size + 1)
        command = np.sign(self._command) * np.maximum(np.abs(self._command) - step * count, 0.0)
        applied = self._attempt(command)
        self._settle()
        return applied

    # -- inside

    def _unfit(self, first_time: float, command_voltage: Array) -> str:
        if command_voltage.shape != (self.block_size,):
            return "wrong block size"
        if not abs(first_time * self.sample_rate - self._next * self.block_size) < 0.5:  # refuses a time of NaN, too
            return "out of turn"
        return ""

    def _cause_present(self) -> str:
        return next(iter(self._present.values()), "")

    def _cannot_start(self) -> str:
        """Find the voltage at the stack; what speaks against following commands from there."""
        if not self._find(at_rest=True):
            return self.reason
        limits = self.limits
        if not limits.voltage_min <= self._voltage <= limits.voltage_max:
            window = f"{limits.voltage_min:g} to {limits.voltage_max:g} V"
            return f"the stack is at {self._voltage:.2f} V, outside {window}; discharge it first"
        return ""

    def _find(self, at_rest: bool = False) -> bool:
        """Go on from the voltage at the stack; a driver that cannot tell it has failed."""
        self._lost = True
        if at_rest:  # nothing is put out: the stack may have been charged to whatever is found
            self._ceiling = math.inf
        try:
            found = self.driver.voltage
        except BenchError as error:
            self._machine.handle(machine.DRIVER_FAILED, str(error))
            return False
        if not math.isfinite(found):
            self._machine.handle(machine.DRIVER_FAILED, f"the driver found {found} V at the stack")
            return False
        self._voltage, self._lost = found, False
        command = found / self.driver.gain
        if self._machine.state == TRIPPED:  # a readback that is wrong must not make the ramp begin with a rise
            command = min(max(command, -self._ceiling), self._ceiling)
        self._command, self._ceiling = command, abs(command)
        return True

    def _settle(self) -> None:
        """Nothing is left to ramp where the command is 0 V and the driver is there to have put it out."""
        if self._machine.state in (RAMPING, TRIPPED) and self._command == 0.0 and not self._lost:
            self._machine.handle(machine.AT_ZERO)

    def _limited(self, wanted: Array) -> Array:
        limits, gain = self.limits, self.driver.gain
        step = limits.slew_rate / gain / self.sample_rate
        command, outside, fast = _limit(
            wanted, self._command, limits.voltage_min / gain, limits.voltage_max / gain, step
        )
        self.counts["limited: voltage window"] += outside
        self.counts["limited: slew rate"] += fast
        return command

    def _attempt(self, command: Array) -> Applied | None:
        try:
            return self._put_out(command)
        except BenchError:
            return None  # `_put_out` has made it a fault

    def _put_out(self, command: Array) -> Applied:
        time = block_times(self._next, self.block_size, self.sample_rate)
        try:
            applied = self.driver.apply(time, command)
        except BenchError as error:
            self._lost = True
            self._ceiling = max(self._ceiling, float(np.max(np.abs(command))))  # a part of it may be out
            self.counts["driver failed"] += 1
            self.trip(machine.DRIVER_FAILED, str(error))
            raise
        self._next += 1
        self._command = float(command[-1])
        self._ceiling = abs(self._command)
        self._voltage = float(applied.voltage[-1])
        self._check(applied)
        return applied

    def _check(self, applied: Applied) -> None:
        """Too much current or power is a fault; so is one that is no number."""
        current, power = block_figures.largest(applied.voltage, applied.current)
        if not current <= self.limits.current:
            limit = 1e3 * self.limits.current
            self.trip(machine.OVER_CURRENT, f"current of {1e3 * current:.1f} mA exceeds the limit of {limit:.1f} mA")
        elif not power <= self.limits.power:
            self.trip(machine.OVER_POWER, f"power of {power:.3g} W exceeds the limit of {self.limits.power:.3g} W")


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
