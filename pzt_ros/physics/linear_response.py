"""A lag and a mode driven by samples with straight lines between them: exact steps, and the way back.

Each step is the closed solution for a straight line of any duration, so sampling may be uneven. A step back divides by
how much the last sample of the input has already come through. Where sampling is slow this is exact; where it is fast,
little has come through, the division turns rounding into ringing, and differences of the wanted output are taken
instead: an error of first order in the step.
"""

from __future__ import annotations

import math

from numba import njit

_FAST = 1.0
"""A step below this many time constants is too fast for the exact inverse of a lag: its noise gain would pass 13."""

_CRITICAL = 1e-9
"""Within this of 1 the square of a damping is taken for 1: sine and cosine of the rest are what they are at 0."""

_SETTLES = 0.9
"""The exact inverse of a mode is taken where its own errors shrink at least by this factor per sample."""


@njit(cache=True, inline="always")
def lag_step(output: float, before: float, now: float, step: float, time_constant: float) -> float:
    """Output of a first-order lag after a `step` [s] in which its input went straight from `before` to `now`."""
    r = step / time_constant
    if r == 0.0:
        return output
    left = math.exp(-r)
    mean = -math.expm1(-r) / r
    return left * output + (mean - left) * before + (1.0 - mean) * now


@njit(cache=True, inline="always")
def lag_inverse(wanted: float, output: float, before: float, step: float, time_constant: float) -> float:
    """The input at the end of a `step` [s] with which the lag comes from `output` to `wanted`."""
    r = step / time_constant
    if r == 0.0:
        return wanted
    if r < _FAST:
        return wanted + (wanted - output) / r
    left = math.exp(-r)
    mean = -math.expm1(-r) / r
    return (wanted - left * output - (mean - left) * before) / (1.0 - mean)


@njit(cache=True)
def _free_motion(step, frequency, damping):  # type: ignore[no-untyped-def]
    """What is left of a deflection and of a velocity: deflection and velocity after a `step` [s] without input."""
    rate, beyond = damping * frequency, damping * damping - 1.0
    root = math.sqrt(abs(beyond))
    if beyond > _CRITICAL:
        slow = math.exp(-step * frequency / (damping + root))
        fast = math.exp(-step * (rate + frequency * root))
        cosine, sine = 0.5 * (slow + fast), 0.5 * (slow - fast) / (frequency * root)
    elif beyond < -_CRITICAL:
        decay = math.exp(-rate * step)
        cosine, sine = decay * math.cos(frequency * root * step), decay * math.sin(frequency * root * step)
        sine /= frequency * root
    else:
        cosine = math.exp(-rate * step)
        sine = cosine * step
    return cosine + rate * sine, sine, -frequency * frequency * sine, cosine - rate * sine


@njit(cache=True)
def mode_step(position, velocity, before, now, step, frequency, damping):  # type: ignore[no-untyped-def]
    """Position and velocity of y'' + 2 D w y' + w^2 (y - u) = 0 after a straight line from `before` to `now`.

    `frequency` is w [rad/s], `damping` is D [-], any: from 1 on these are two lags in a row.
    """
    if step == 0.0:
        return position, velocity
    xx, xv, vx, vv = _free_motion(step, frequency, damping)
    slope = (now - before) / step
    behind = 2.0 * damping / frequency * slope  # a mode follows a straight line, this much behind it
    deflection, excess = position - before + behind, velocity - slope
    return now - behind + xx * deflection + xv * excess, slope + vx * deflection + vv * excess


@njit(cache=True)
def mode_inverse_settles(step, frequency, damping):  # type: ignore[no-untyped-def]
    """Whether the errors of the exact inverse of a mode die out at this `step` [s]; otherwise it rings without end."""
    xx, xv, vx, vv = _free_motion(step, frequency, damping)
    behind = 2.0 * damping / frequency
    through = step - behind * (1.0 - xx) - xv
    # How an error of (velocity, input) goes on to the next sample while the position is met.
    s_v, s_u = -xv / through, -(1.0 - xx) / through
    v_v = s_v + vx * behind * s_v + vv * (1.0 - s_v)
    v_u = s_u - vx * (1.0 - behind * s_u) - vv * s_u
    u_v, u_u = step * s_v, 1.0 + step * s_u
    trace, determinant = (v_v + u_u) / _SETTLES, (v_v * u_u - v_u * u_v) / (_SETTLES * _SETTLES)
    return abs(determinant) < 1.0 and abs(trace) < 1.0 + determinant


@njit(cache=True)
def mode_inverse(wanted, position, velocity, before, step, frequency, damping):  # type: ignore[no-untyped-def]
    """The input at the end of a `step` [s] with which the mode comes to the position `wanted`, and the velocity."""
    if step == 0.0:
        return wanted, velocity
    behind = 2.0 * damping / frequency
    if mode_inverse_settles(step, frequency, damping):
        xx, xv, vx, vv = _free_motion(step, frequency, damping)
        through = step - behind * (1.0 - xx) - xv
        slope = (wanted - before - xx * (position - before) - xv * velocity) / through
        deflection, excess = position - before + behind * slope, velocity - slope
        return before + step * slope, slope + vx * deflection + vv * excess
    slope = (wanted - position) / step
    return wanted + behind * slope + (slope - velocity) / (step * frequency * frequency), slope
