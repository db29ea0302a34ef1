"""One branch of the parametrized model, and the memory of reversal points (thesis 3.3, 3.34, 3.35), compiled.

On a branch from reversal point to reversal point the barrier is B = b (+-1 + s w) with erfc(-w) linear in x: that is
(3.34) solved for x, so w is the unknown and no inverse erfc is ever needed. x and 1 - x are carried both, each exact in
the tail where it is small. Everything the model knows is one flat array, laid out below.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from pzt_ros.physics.kinetics import erfcx_positive
from pzt_ros.physics.signals import Array

compiled = njit(cache=True, error_model="numpy")
"""Division by zero gives inf or NaN, which the steps test for. No fast math: step and inverse agree to the bit."""
inlined = njit(cache=True, error_model="numpy", forceinline=True)
"""The same for what runs once per sample: handing on state and material costs as much as evaluating the model."""


class Material(NamedTuple):
    """The numbers of the model in SI; barriers b and shapes s of (3.34) for the ascending and descending branches."""

    barrier_ascending: float
    shape_ascending: float
    barrier_descending: float
    shape_descending: float
    relaxation_time: float
    thermal_width: float
    domain_polarization: float
    reciprocal_permittivity: float
    layer_thickness: float
    accuracy: float


# The state is one flat array: these numbers, then the stack of reversal points.
TIME: Final = 0  # of the last sample [s]
FIELD: Final = 1  # there [V/m]
RATE: Final = 2  # field rate that led there [V/m/s]
W: Final = 3  # barrier, as w
X: Final = 4  # phase fraction x+ and its complement 1 - x+
XC: Final = 5
X_W: Final = 6  # dx/dw
F: Final = 7  # dx/dt [1/s]
F_W: Final = 8  # its derivative by w at constant field
STEP: Final = 9  # internal step to try next [s]
PAST: Final = 10  # length of the previous internal step [s]; 0 when it is no guide to the next one
PAST_W: Final = 11  # its w at the start and at the two inner stages
COUNT: Final = 14  # points on the stack
REVERSALS: Final = 15  # since the pre-history
CLOSURES: Final = 16
# The branch that is being followed; "low" and "high" are its two reversal points.
DIRECTION: Final = 17  # +1 ascending, -1 descending
CENTRE: Final = 18  # B = CENTRE + SLOPE w [V/m]
SLOPE: Final = 19
W_LOW: Final = 20
W_HIGH: Final = 21
X_LOW: Final = 22
XC_LOW: Final = 23
X_HIGH: Final = 24
XC_HIGH: Final = 25
SHIFT: Final = 26  # erfc is scaled by exp(SHIFT), so that branches far out in a tail keep their digits
STRETCH: Final = 27  # dx / d(scaled erfc)
TAIL_LOW: Final = 28  # scaled erfc(-W_LOW) and erfc(W_HIGH)
TAIL_HIGH: Final = 29
PAST_GAIN: Final = 30  # by how much x rose in the previous internal step
PAST_MISS: Final = 31  # and by how much that differed from its quadratic prediction
STEEPNESS: Final = 32  # SLOPE by the thermal width: how sharply the rates depend on w
STACK: Final = 33

DEPTH: Final = 512
"""Reversal points that fit: 256 nested loops; beyond, the innermost loop is forgotten."""
SIZE: Final = STACK + 3 * DEPTH


_TWO_BY_SQRT_PI = 2.0 / math.sqrt(math.pi)
_MARGIN = 0.25  # how far beyond the reversal point ahead an iterate of w may go


@inlined
def evaluate(state: Array, m: Material, w: float, field: float) -> tuple[float, float, float, float, float]:
    """x, 1 - x, dx/dw, f = dx/dt [1/s] and df/dw on the present branch at barrier w and field [V/m] (3.8 to 3.10)."""
    gauss = math.exp(state[SHIFT] - w * w)
    tail = gauss * erfcx_positive(abs(w))
    x_w = state[STRETCH] * _TWO_BY_SQRT_PI * gauss
    if w < 0.0:
        gone = state[STRETCH] * (tail - state[TAIL_LOW])
        x, xc = state[X_LOW] + gone, state[XC_LOW] - gone
    else:
        left = state[STRETCH] * (tail - state[TAIL_HIGH])
        x, xc = state[X_HIGH] - left, state[XC_HIGH] + left

    z = (field - state[CENTRE]) / m.thermal_width - state[STEEPNESS] * w
    a = abs(z)
    g = erfcx_positive(a)
    e = math.exp(-a * a)
    fast, slow = 1.0 / g, e / (2.0 - e * g)
    up, down = (fast, slow) if z >= 0.0 else (slow, fast)
    f_z = up * (_TWO_BY_SQRT_PI * up - 2.0 * z) * xc + down * (_TWO_BY_SQRT_PI * down + 2.0 * z) * x
    per_time = 1.0 / m.relaxation_time
    f = (up * xc - down * x) * per_time
    f_w = -(f_z * state[STEEPNESS] + (up + down) * x_w) * per_time
    return x, xc, x_w, f, f_w


@compiled
def limits(state: Array) -> tuple[float, float]:
    """Range of w for iterates: from where the branch began to just beyond the point ahead, if it can be passed."""
    margin = _MARGIN if state[COUNT] >= 4.0 else 0.0
    if state[DIRECTION] > 0.0:
        return state[W_LOW], state[W_HIGH] + margin
    return state[W_LOW] - margin, state[W_HIGH]


@compiled
def room(state: Array, w: float) -> float:
    """Distance in w left to the reversal point ahead; a saturation point is never reached."""
    if state[COUNT] < 4.0:
        return math.inf
    return state[W_HIGH] - w if state[DIRECTION] > 0.0 else w - state[W_LOW]


@compiled
def refresh(state: Array, m: Material) -> None:
    """Recompute what depends on w and the field."""
    state[X], state[XC], state[X_W], state[F], state[F_W] = evaluate(state, m, state[W], state[FIELD])


@compiled
def follow_branch(state: Array, m: Material) -> None:
    """Set up the branch between the two topmost reversal points: x linear in erfc(-w) through both (3.35)."""
    count = int(state[COUNT])
    ascending = count % 2 == 0
    low = STACK + 3 * (count - 1 if ascending else count - 2)
    high = STACK + 3 * (count - 2 if ascending else count - 1)
    barrier = m.barrier_ascending if ascending else m.barrier_descending
    shape = m.shape_ascending if ascending else m.shape_descending
    direction = 1.0 if ascending else -1.0
    centre, slope = direction * barrier, barrier * shape
    x_low, xc_low, w_low = state[low], state[low + 1], (state[low + 2] - centre) / slope
    x_high, xc_high, w_high = (
        state[high],
        state[high + 1],
        (state[high + 2] - centre) / slope,
    )

    nearest = max(w_low, 0.0) if w_high > 0.0 else w_high
    shift = nearest * nearest
    whole = 2.0 * math.exp(min(shift, 700.0))
    tail_low = math.exp(shift - w_low * w_low) * erfcx_positive(abs(w_low))
    tail_high = math.exp(shift - w_high * w_high) * erfcx_positive(abs(w_high))
    if w_high < 0.0:
        width = tail_high - tail_low
    elif w_low >= 0.0:
        width = tail_low - tail_high
    else:
        width = whole - tail_low - tail_high
    span = x_high - x_low if x_low < 0.5 else xc_low - xc_high

    state[DIRECTION], state[CENTRE], state[SLOPE] = direction, centre, slope
    state[STEEPNESS] = slope / m.thermal_width
    state[W_LOW], state[X_LOW], state[XC_LOW] = w_low, x_low, xc_low
    state[W_HIGH], state[X_HIGH], state[XC_HIGH] = w_high, x_high, xc_high
    state[SHIFT] = shift
    state[STRETCH] = max(span, 0.0) / width if width > 0.0 else 0.0
    state[TAIL_LOW] = tail_low if w_low < 0.0 else whole - tail_low
    state[TAIL_HIGH] = tail_high if w_high >= 0.0 else whole - tail_high
    state[PAST] = 0.0


@compiled
def reverse(state: Array, m: Material) -> None:
    """Store the present point as a reversal point and go on along the opposite branch."""
    count = int(state[COUNT])
    if count == DEPTH:
        count -= 2
    barrier = state[CENTRE] + state[SLOPE] * state[W]
    top = STACK + 3 * count
    state[top], state[top + 1], state[top + 2] = (
        max(state[X], 0.0),
        max(state[XC], 0.0),
        barrier,
    )
    state[COUNT] = count + 1
    state[REVERSALS] += 1.0
    follow_branch(state, m)
    state[W] = (barrier - state[CENTRE]) / state[SLOPE]
    refresh(state, m)


@compiled
def close_loop(state: Array, m: Material) -> None:
    """The loop is closed: forget its two reversal points and go on along the branch that it interrupted."""
    w = state[W_HIGH] if state[DIRECTION] > 0.0 else state[W_LOW]
    state[COUNT] -= 2.0
    state[CLOSURES] += 1.0
    follow_branch(state, m)
    state[W] = w
    refresh(state, m)


@compiled
def fresh_state(m: Material, saturation_barrier: float) -> Array:
    """Negatively saturated at time 0 and field 0: x = 0, B = -B_sat, ascending."""
    state = np.zeros(SIZE)
    state[STACK], state[STACK + 1], state[STACK + 2] = 1.0, 0.0, saturation_barrier
    state[STACK + 3], state[STACK + 4], state[STACK + 5] = 0.0, 1.0, -saturation_barrier
    state[COUNT] = 2.0
    state[STEP] = math.inf
    follow_branch(state, m)
    state[W] = state[W_LOW]
    refresh(state, m)
    return state


@compiled
def polarization(state: Array, m: Material) -> float:
    """P = E/E1 + (2x - 1) P_T [C/m^2] (3.20)."""
    return state[FIELD] / m.reciprocal_permittivity + (state[X] - state[XC]) * m.domain_polarization
