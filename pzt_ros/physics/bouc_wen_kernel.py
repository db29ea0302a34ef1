"""Elements that slip: the compiled loops of the Bouc-Wen model, exact however far apart two samples are."""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from pzt_ros.physics.bracketing import NEWTON, narrowed
from pzt_ros.physics.signals import Array

TIME, VOLTAGE, SLOPE, HEAD = 0, 1, 2, 3
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], slip of every element [-]."""

_NO_SUCH_FIELD = 1e9  # [V/m]
_MAX_TRIALS = 200
_STRAIGHT = 1e-9  # 2 shape - 1 below which an element goes straight to the middle


class Elements(NamedTuple):
    """What the compiled loops need.

    Attributes:
        heights: polarization that each element holds back [C/m^2, shape (n,)].
        fields: over which each begins to slip [V/m, shape (n,)].
        shapes: of the way back: 1 as steep as from rest, 0.5 straight [-, shape (n,)].
        growth: of all heights with the field [m/V].
        susceptibility: with all elements slipping [C/(V m)].
        offset: of what never moves [C/m^2].
        layer_thickness: [m].
    """

    heights: Array
    fields: Array
    shapes: Array
    growth: float
    susceptibility: float
    offset: float
    layer_thickness: float


@njit(cache=True, error_model="numpy")
def _slipped(z, way, shape):  # type: ignore[no-untyped-def]
    """The slip after the field went straight on by `way`, in units of the element's field, and how it changes with it.

    Upwards dz/dx = 1 - shape z - (1 - shape)|z|, an exponential on either side of 0; downwards the same mirrored.
    """
    sign = 1.0 if way >= 0.0 else -1.0
    z, x = sign * z, abs(way)
    if z < 0.0:
        curve = 2.0 * shape - 1.0
        if curve > _STRAIGHT:
            to_middle = math.log1p(-curve * z) / curve
            if x <= to_middle:
                z += (1.0 - curve * z) * -math.expm1(-curve * x) / curve
                return sign * z, 1.0 - curve * z
        else:
            to_middle = -z
            if x <= to_middle:
                return sign * (z + x), 1.0
        z, x = 0.0, x - to_middle
    z = 1.0 - (1.0 - z) * math.exp(-x)
    return sign * z, 1.0 - z


@njit(cache=True, error_model="numpy")
def _polarization(state, elements, field):  # type: ignore[no-untyped-def]
    """P after the field went straight to a value [C/m^2], and how it changes with the field from there on."""
    way = field - state[VOLTAGE] / elements.layer_thickness
    held, climb = 0.0, 0.0
    for i in range(elements.heights.size):
        z, slope = _slipped(state[HEAD + i], way / elements.fields[i], elements.shapes[i])
        held += elements.heights[i] * z
        climb += elements.heights[i] * slope / elements.fields[i]
    grown = 1.0 + elements.growth * field
    steepness = elements.susceptibility
    if grown > 0.0:
        steepness -= grown * climb + elements.growth * held
    return elements.susceptibility * field - max(grown, 0.0) * held + elements.offset, steepness


@njit(cache=True, error_model="numpy")
def _go(state, elements, time, field):  # type: ignore[no-untyped-def]
    """Move the state to the next sample; return how much of all that slips has slipped upwards."""
    way = field - state[VOLTAGE] / elements.layer_thickness
    held, total = 0.0, 0.0
    for i in range(elements.heights.size):
        state[HEAD + i], _ = _slipped(state[HEAD + i], way / elements.fields[i], elements.shapes[i])
        held += abs(elements.heights[i]) * state[HEAD + i]
        total += abs(elements.heights[i])
    state[TIME], state[VOLTAGE] = time, field * elements.layer_thickness
    return 0.5 + 0.5 * held / total if total > 0.0 else 0.5


@njit(cache=True, error_model="numpy", nogil=True)
def run(state, elements, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    for k in range(time.size):
        field = voltage[k] / elements.layer_thickness
        if not (time[k] - state[TIME] >= 0.0 and math.isfinite(time[k]) and abs(field) <= _NO_SUCH_FIELD):
            return k
        polarization[k], _ = _polarization(state, elements, field)
        phase_fraction[k] = _go(state, elements, time[k], field)
    return -1


@njit(cache=True, error_model="numpy")
def run_inverse(state, elements, time, target, voltage, phase_fraction, limit, tolerance):  # type: ignore[no-untyped-def]
    """Find the voltage at the end of each sample that gives the target polarization [C/m^2]; otherwise as `run`.

    A root is searched within +-limit [V]; where there is none, the limit is the answer.
    """
    widest = limit / elements.layer_thickness
    for k in range(time.size):
        if not (time[k] - state[TIME] >= 0.0 and math.isfinite(time[k])):
            return k
        field = state[VOLTAGE] / elements.layer_thickness
        if math.isfinite(target[k]):
            field = _root(state, elements, target[k], field, widest, tolerance)
        _, steepness = _polarization(state, elements, field)
        state[SLOPE] = steepness / elements.layer_thickness
        phase_fraction[k] = _go(state, elements, time[k], field)
        voltage[k] = state[VOLTAGE]
    return -1


@njit(cache=True, error_model="numpy")
def _root(state, elements, target, field, widest, tolerance):  # type: ignore[no-untyped-def]
    """The field that gives a target [V/m]; the bracket is halved from the trial NEWTON on."""
    low, high = -widest, widest
    for count in range(_MAX_TRIALS):
        found, steepness = _polarization(state, elements, field)
        miss = found - target
        if abs(miss) <= tolerance or high - low <= 1e-15 * widest:
            break
        low, high, field = narrowed(low, high, field, miss, steepness, count >= NEWTON)
    return field
