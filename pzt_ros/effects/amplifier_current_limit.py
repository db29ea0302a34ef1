"""Current limit of the amplifier where the record has only the command."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.link import AMPLIFIER, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _COMMAND, _OUTPUT, _SIZE = 0, 1, 2, 3, 4


@dataclass(frozen=True, kw_only=True)
class AmplifierCurrentLimit(Link):
    """The voltage follows the command no faster than the largest current charges the capacitance: |dU/dt| <= I/C.

    Given as C/I, so that 0 is no limit. The capacitance is taken as constant; the amplifier link knows a limit that
    feels the ceramic's switching.
    """

    kind: ClassVar[str] = "amplifier_current_limit"
    section: ClassVar[str] = AMPLIFIER

    inverse_slew: float = parameter(
        0.0, "s/V", "capacitance over largest current; 0 for no limit", symbol="C/I", bounds=(0.0, 1e3)
    )

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; time [s], command and voltage [V]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Command to voltage; exact at the samples for a command of straight lines."""
        after, out = state.copy(), np.empty_like(signals.voltage)
        _limit(after, signals.time, signals.voltage, out, self._slew)
        return after, signals.replace(voltage=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage wanted to command: the voltage itself. What is beyond the limit cannot be had."""
        after, out = state.copy(), np.empty_like(signals.voltage)
        _limit(after, signals.time, signals.voltage, out, self._slew)
        return after, signals.replace(voltage=signals.voltage.copy())

    @property
    def _slew(self) -> float:
        """Largest rate of change [V/s]."""
        return 1.0 / self.inverse_slew if self.inverse_slew > 0.0 else math.inf


@njit(cache=True)
def _after(behind: float, command: float, rate: float, step: float, slew: float) -> float:
    """Voltage at the end of a `step` [s] in which the command, `behind` [V] ahead, went on at `rate` to `command`.

    The voltage goes towards the command as fast as it may until both meet, then follows it as well as it can.
    """
    if behind != 0.0:
        closing = slew - math.copysign(rate, rate * behind)
        if closing * step <= abs(behind):
            return command - math.copysign(abs(behind) - closing * step, behind)
        step -= abs(behind) / closing
    too_fast = max(abs(rate) - slew, 0.0) * step
    return command - math.copysign(too_fast, rate)


@njit(cache=True)
def _limit(state: Array, time: Array, command: Array, out: Array, slew: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            state[_SEEN], state[_TIME], state[_COMMAND], state[_OUTPUT] = 1.0, time[k], command[k], command[k]
        step = time[k] - state[_TIME]
        if slew == math.inf or step <= 0.0:
            state[_OUTPUT] = command[k] if slew == math.inf else state[_OUTPUT]
        else:
            rate = (command[k] - state[_COMMAND]) / step
            state[_OUTPUT] = _after(state[_COMMAND] - state[_OUTPUT], command[k], rate, step, slew)
        state[_TIME], state[_COMMAND], out[k] = time[k], command[k], state[_OUTPUT]
