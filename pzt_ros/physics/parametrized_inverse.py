"""The inverse of the parametrized model, sample by sample: the field whose step ends at the polarization asked for."""

from __future__ import annotations

import math
from typing import Final

from pzt_ros.physics.parametrized_branch import (
    CLOSURES,
    F_W,
    FIELD,
    RATE,
    REVERSALS,
    SLOPE,
    STACK,
    TIME,
    X_W,
    Material,
    X,
    compiled,
    inlined,
    polarization,
)
from pzt_ros.physics.parametrized_kernel import advance
from pzt_ros.physics.signals import Array

FIELD_LIMIT: Final = 1e7
"""Largest field that the inverse gives [V/m]."""
TOLERANCE: Final = 1e-3
"""Share of the accuracy to which the inverse meets the phase fraction that its target asks for."""


@inlined
def _copy(source: Array, target: Array) -> None:
    """Copy a state; the stack only where it differs. A loop, since Numba allocates memory to assign a slice."""
    if source[REVERSALS] != target[REVERSALS] or source[CLOSURES] != target[CLOSURES]:
        for i in range(STACK, source.size):
            target[i] = source[i]
    for i in range(STACK):
        target[i] = source[i]


@inlined
def _trial(state: Array, saved: Array, m: Material, time: float, field: float) -> float:
    """P at `time` if the field went straight to `field` from the `saved` state; leaves the outcome in `state`."""
    _copy(saved, state)
    advance(state, m, time, field)
    return polarization(state, m)


@compiled
def susceptibility(state: Array, m: Material, duration: float) -> float:
    """Roughly dP/dE [F/m] over a step of `duration` [s]: a linear implicit step, for the first guess in a block."""
    weight = -0.5 * max(duration, 0.0) * state[F_W]
    switching = weight * state[X_W] / (state[SLOPE] * (state[X_W] + weight + 1e-300))
    return 1.0 / m.reciprocal_permittivity + 2.0 * m.domain_polarization * switching


@compiled
def run_inverse(state: Array, numbers: tuple[float, ...], time: Array, p: Array, voltage: Array, x: Array) -> int:
    """Fill `voltage` so that `run` on it gives the polarization `p` [all of shape (n,)]; `state` changes as in `run`.

    P rises with the field at the end of the step, so each sample is a scalar equation for that field: secant steps
    inside a bracket. They start where the field bends as it did before, and by more as P bends more. Where FIELD_LIMIT
    does not suffice, the limit is taken; a target that is no number keeps the field. Returns the number of model steps.
    """
    m = Material(*numbers)
    tolerance = TOLERANCE * m.accuracy * m.domain_polarization
    saved = state.copy()
    steps = 0
    slope = susceptibility(state, m, time[0] - state[TIME]) if time.size else 0.0
    reached = polarization(state, m)
    p_rate = bend = old_bend = 0.0
    for i in range(time.size):
        duration = max(time[i] - saved[TIME], 0.0)
        low, high = -FIELD_LIMIT, FIELD_LIMIT
        straight = saved[FIELD] + saved[RATE] * duration
        field = straight
        if i > 1:
            field += (p[i] - reached - p_rate * duration) / slope + bend + (bend - old_bend if i > 2 else 0.0)
        if math.isnan(p[i]):
            field = saved[FIELD]
        old_field = old_excess = 0.0
        for n in range(80):
            # through the voltage, so that `run` on it sees the same field to the bit
            field = min(max(field, -FIELD_LIMIT), FIELD_LIMIT) * m.layer_thickness / m.layer_thickness
            excess = _trial(state, saved, m, time[i], field) - p[i]
            steps += 1
            if not abs(excess) > tolerance:
                break
            low, high = (low, field) if excess > 0.0 else (field, high)
            if high - low <= 1e-15 * FIELD_LIMIT:
                break
            if n > 0 and (excess - old_excess) * (field - old_field) > 0.0:
                slope = (excess - old_excess) / (field - old_field)
            old_field, old_excess = field, excess
            field -= excess / slope
            if (n > 8 and n % 2 == 0) or not low <= field <= high:
                field = 0.5 * (low + high)
        voltage[i] = state[FIELD] * m.layer_thickness
        x[i] = min(max(state[X], 0.0), 1.0)
        _copy(state, saved)
        p_now = polarization(state, m)
        old_bend, bend = bend, state[FIELD] - straight - (p_now - reached - p_rate * duration) / slope
        p_rate = (p_now - reached) / duration if duration > 0.0 else 0.0
        reached = p_now
    return steps
