"""Gains of a lag and of a mode over one sample step, so that they are worked out once for a run of equal steps.

A step is linear in what it starts from, so its answers to units are its gains; the physics stays in
`physics.linear_response`.
"""

from __future__ import annotations

from numba import njit

from pzt_ros.physics.linear_response import lag_step, mode_step

_SAME = 1e-8
"""Steps closer than this part of themselves count as one: sample times are rounded numbers."""


@njit(cache=True, inline="always")
def other_step(step: float, known: float) -> bool:
    """Whether gains worked out for the step `known` [s] are of no use for `step` [s]."""
    return abs(step - known) > _SAME * step


@njit(cache=True)
def lag_gains(step: float, time_constant: float) -> tuple[float, float, float]:
    """What a lag keeps of its output, and takes of its input at the start and at the end of the step [-]."""
    if time_constant == 0.0:
        return 0.0, 0.0, 1.0
    kept, last = lag_step(1.0, 0.0, 0.0, step, time_constant), lag_step(0.0, 0.0, 1.0, step, time_constant)
    return kept, 1.0 - kept - last, last  # at rest a lag stays where it is


@njit(cache=True)
def mode_gains(step, frequency, damping):  # type: ignore[no-untyped-def]
    """How deflection (position minus input) and velocity of a mode follow from deflection, velocity, change of input.

    `frequency` in rad/s. Deflections rather than positions, so that a mode at rest stays where it is to the bit.
    """
    if step == 0.0:
        return 1.0, 0.0, -1.0, 0.0, 1.0, 0.0
    dd, vd = mode_step(1.0, 0.0, 0.0, 0.0, step, frequency, damping)
    dv, vv = mode_step(0.0, 1.0, 0.0, 0.0, step, frequency, damping)
    du, vu = mode_step(0.0, 0.0, 0.0, 1.0, step, frequency, damping)
    return dd, dv, du - 1.0, vd, vv, vu
