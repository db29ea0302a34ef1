"""What passes a mode in part, sample by sample: forwards, for many columns at once, and back.

A mode of the structure, or, where all passes, a low-pass of second order: its damping may be anything.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pzt_ros.effects.sampling import mode_gains, other_step
from pzt_ros.physics.change import Columns
from pzt_ros.physics.signals import Array

_SEEN, _TIME, _INPUT, _STEP, _DEFLECTION, _VELOCITY, STATE_SIZE = 0, 1, 2, 3, 4, 5, 6
"""Of a state: whether a sample was seen; time [s], input, last step [s], deflection and velocity."""

_LEAST_THROUGH = 0.1
"""The exact inverse is taken where at least this part of a sample comes out at once: its noise gain stays below 10."""


@njit(cache=True)
def _begin(state: Array, time: float, displacement: float) -> None:
    state[_SEEN], state[_TIME], state[_INPUT] = 1.0, time, displacement


@njit(cache=True)
def follow(state: Array, time: Array, free: Array, out: Array, frequency: float, damping: float, share: float) -> None:
    """The input and what the mode adds to it."""
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
def follow_columns(time: Array, free: Columns, out: Columns, frequency: float, damping: float, share: float) -> None:
    """`follow` for many columns at once, which differ in their input only."""
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
def settles(gains: tuple[float, float, float, float, float, float], share: float, shrink: float) -> bool:
    """Whether the errors of the exact inverse shrink by a factor per sample while what is wanted is met (Jury)."""
    dd, dv, du, vd, vv, vu = gains
    through = 1.0 + share * du
    if through < _LEAST_THROUGH:
        return False
    d_d, d_v = (dd + share * du) / through, dv / through
    v_d, v_v = vd + share * vu * (1.0 - d_d), vv - share * vu * d_v
    trace, determinant = (d_d + v_v) / shrink, (d_d * v_v - d_v * v_d) / (shrink * shrink)
    return abs(determinant) < 1.0 and abs(trace) < 1.0 + determinant


@njit(cache=True)
def lead(
    state: Array, time: Array, wanted: Array, free: Array, frequency: float, damping: float, share: float, shrink: float
) -> None:
    """The input with which what is wanted comes out; by differences where errors of the exact one would stay."""
    gains = mode_gains(state[_STEP], frequency, damping)
    exact = settles(gains, share, shrink)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k])
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            gains = mode_gains(step, frequency, damping)
            exact = settles(gains, share, shrink)
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
