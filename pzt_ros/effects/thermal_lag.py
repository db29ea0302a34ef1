"""Drift of the reading with a body whose temperature comes after the one that is measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.added import AddedToReading
from pzt_ros.effects.sampling import lag_gains, other_step
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _START, _WARM, _TIME, _FIRST, _MEASURED, _BODY, _SIZE = 0, 1, 2, 3, 4, 5, 6, 7


@dataclass(frozen=True, kw_only=True)
class ThermalLag(AddedToReading):
    """Added to the displacement: expansion * (T_late - T(0)) + missing_expansion * (1 - exp(-t/time_constant)).

    T_late follows the measured T as a body in that air does (Newton's law of cooling), by one lag that starts at T(0).
    How far the body was off as a run began nobody knows: the second term is what it still had to expand by then, a
    number of each run. Without a recorded temperature there is only that term. Time counts from the first sample.
    """

    kind: ClassVar[str] = "thermal_lag"

    expansion: float = parameter(0.0, "m/K", "displacement over temperature of the body", bounds=(-1e-3, 1e-3))
    time_constant: float = parameter(10.0, "s", "by which the body follows the air", bounds=(1e-2, 1e6))
    missing_expansion: float = parameter(0.0, "m", "that is still to come as a run begins", bounds=(-1e-3, 1e-3))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen and when [s]; whether a temperature, when last, the first and last, the body's."""
        return np.zeros(_SIZE)

    def _disturbance(self, state: State, signals: Signals) -> tuple[State, Array]:
        after, time = state.copy(), signals.time
        if time.size and after[_SEEN] == 0.0:
            after[_SEEN], after[_START] = 1.0, time[0]
        added: Array = -self.missing_expansion * np.expm1(-(time - after[_START]) / self.time_constant)
        if signals.temperature.size:
            added += self.expansion * _warmth(after, time, signals.temperature, self.time_constant)
        return after, added


@njit(cache=True)
def _warmth(state: Array, time: Array, temperature: Array, time_constant: float) -> Array:
    """How much warmer the body is than what was measured first [K, shape (n,)]."""
    if state[_WARM] == 0.0:
        state[_WARM], state[_TIME] = 1.0, time[0]
        state[_FIRST] = state[_MEASURED] = state[_BODY] = temperature[0]
    warmth = np.empty(time.size)
    known, (kept, first, last) = 0.0, lag_gains(0.0, time_constant)
    for k in range(time.size):
        step = time[k] - state[_TIME]
        if other_step(step, known):
            known, (kept, first, last) = step, lag_gains(step, time_constant)
        state[_BODY] = kept * state[_BODY] + first * state[_MEASURED] + last * temperature[k]
        state[_TIME], state[_MEASURED] = time[k], temperature[k]
        warmth[k] = state[_BODY] - state[_FIRST]
    return warmth
