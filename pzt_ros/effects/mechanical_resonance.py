"""A mode of the structure that the sensor sees in part."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.sampling import mode_gains, other_step
from pzt_ros.physics.change import Change, Columns
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _INPUT, _STEP, _DEFLECTION, _VELOCITY, _SIZE = 0, 1, 2, 3, 4, 5, 6

_LEAST_THROUGH = 0.1
"""The exact inverse is taken where at least this part of a sample comes out at once: its noise gain stays below 10."""


@dataclass(frozen=True, kw_only=True)
class MechanicalResonance(Link):
    """y + share * deflection of a mode driven by y; share 1 is a mode in the path of the motion, less one beside it.

    The same as (1 - share) * y + share * mode(y). The link starts at rest wherever its first sample is.
    """

    kind: ClassVar[str] = "mechanical_resonance"
    section: ClassVar[str] = ACTUATOR

    share: float = parameter(0.0, "1", "part of the displacement that passes the mode", bounds=(0.0, 1.0))
    frequency: float = parameter(500.0, "Hz", "undamped frequency of the mode", symbol="f_0", bounds=(0.1, 1e6))
    damping_ratio: float = parameter(
        0.02, "1", "damping over critical; above a half nothing rings", symbol="D", bounds=(1e-4, 0.5)
    )

    def prompt(self) -> MechanicalResonance:
        """Without the mode."""
        return dataclasses.replace(self, share=0.0) if self.share > 0.0 else self

    def inverse_looks_back(self, step: float) -> bool:
        """Where nearly all passes a finely sampled mode."""
        frequency, damping, share = self._mode
        return share > 0.0 and not _settles(mode_gains(step, frequency, damping), share)

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; time [s], input [m], last step [s], deflection [m] and velocity [m/s]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement before the mode to displacement."""
        after, out = state.copy(), np.empty_like(signals.displacement)
        _follow(after, signals.time, signals.displacement, out, *self._mode)
        return after, signals.replace(displacement=out)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The change with what the mode makes of it: the link is linear."""
        out = np.empty_like(change.displacement, order="C")
        _follow_columns(signals.time, change.displacement, out, *self._mode)
        return dataclasses.replace(change, displacement=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to displacement before the mode; exact unless nearly all passes a finely sampled mode.

        There the exact inverse rings without end; velocity and acceleration are then differences of what is wanted.
        """
        after, needed = state.copy(), np.empty_like(signals.displacement)
        _lead(after, signals.time, signals.displacement, needed, *self._mode)
        return after, signals.replace(displacement=needed)

    @property
    def _mode(self) -> tuple[float, float, float]:
        return 2.0 * math.pi * self.frequency, self.damping_ratio, self.share


@njit(cache=True)
def _begin(state: Array, time: float, displacement: float) -> None:
    state[_SEEN], state[_TIME], state[_INPUT] = 1.0, time, displacement


@njit(cache=True)
def _follow(state: Array, time: Array, free: Array, out: Array, frequency: float, damping: float, share: float) -> None:
    dd, dv, du, vd, vv, vu = mode_gains(state[_STEP], frequency, damping)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], free[k])
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            dd, dv, du, vd, vv, vu = mode_gains(step, frequency, damping)
        d, v, change = state[_DEFLECTION], state[_VELOCITY], free[k] - state[_INPUT]
        state[_DEFLECTION] = dd * d + dv * v + du * change
        state[_VELOCITY] = vd * d + vv * v + vu * change
        state[_TIME], state[_INPUT] = time[k], free[k]
        out[k] = free[k] + share * state[_DEFLECTION]


@njit(cache=True)
def _follow_columns(time: Array, free: Columns, out: Columns, frequency: float, damping: float, share: float) -> None:
    """`_follow` for many columns at once, which differ in their input only."""
    deflection, velocity = np.zeros(free.shape[1]), np.zeros(free.shape[1])
    dd, dv, du, vd, vv, vu = mode_gains(0.0, frequency, damping)
    out[0], known = free[0], 0.0
    for k in range(1, time.size):
        step = time[k] - time[k - 1]
        if other_step(step, known):
            known = step
            dd, dv, du, vd, vv, vu = mode_gains(step, frequency, damping)
        for i in range(free.shape[1]):
            d, v, change = deflection[i], velocity[i], free[k, i] - free[k - 1, i]
            deflection[i] = dd * d + dv * v + du * change
            velocity[i] = vd * d + vv * v + vu * change
            out[k, i] = free[k, i] + share * deflection[i]


@njit(cache=True)
def _settles(gains: tuple[float, float, float, float, float, float], share: float) -> bool:
    """Whether the errors of the exact inverse die out while the displacement wanted is met (Jury's criterion)."""
    dd, dv, du, vd, vv, vu = gains
    through = 1.0 + share * du
    if through < _LEAST_THROUGH:
        return False
    d_d, d_v = (dd + share * du) / through, dv / through
    v_d, v_v = vd + share * vu * (1.0 - d_d), vv - share * vu * d_v
    determinant = d_d * v_v - d_v * v_d
    return abs(determinant) < 1.0 and abs(d_d + v_v) < 1.0 + determinant


@njit(cache=True)
def _lead(
    state: Array, time: Array, wanted: Array, free: Array, frequency: float, damping: float, share: float
) -> None:
    gains = mode_gains(state[_STEP], frequency, damping)
    exact = _settles(gains, share)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k])
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            gains = mode_gains(step, frequency, damping)
            exact = _settles(gains, share)
        dd, dv, du, vd, vv, vu = gains
        d, v, before = state[_DEFLECTION], state[_VELOCITY], state[_INPUT]
        if step == 0.0:
            free[k] = wanted[k] - share * d
        elif exact:
            free[k] = (wanted[k] - share * (dd * d + dv * v - du * before)) / (1.0 + share * du)
            state[_DEFLECTION] = dd * d + dv * v + du * (free[k] - before)
            state[_VELOCITY] = vd * d + vv * v + vu * (free[k] - before)
        else:
            slope = (wanted[k] - before - share * d) / step
            acceleration = (slope - v) / step
            state[_DEFLECTION] = -(2.0 * damping * frequency * slope + acceleration) / (frequency * frequency)
            state[_VELOCITY] = slope
            free[k] = wanted[k] - share * state[_DEFLECTION]
        state[_TIME], state[_INPUT] = time[k], free[k]
