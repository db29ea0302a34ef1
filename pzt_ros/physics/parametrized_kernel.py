"""The compiled parametrized model: one stiff scalar ODE per branch, and a stack of reversal points (thesis 3.3, 3.34, 3.35).

On a branch from reversal point to reversal point the barrier is B = b (+-1 + s w) with erfc(-w) linear in x: that is (3.34)
solved for x, so w is the unknown and no inverse erfc is ever needed. x and 1 - x are carried both, each from the tail in
which it is small. A step solves the 3-stage Radau IIA equations for the three stage values of w.

Along E(t) linear in t, dx/dt on an ascending branch can fall through zero only while E falls, and then once: at dx/dt = 0
its derivative is (df/dE) dE/dt. So a branch can turn only against the field, which rules chatter out by construction.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from pzt_ros.physics.kinetics import erfcx_positive
from pzt_ros.physics.signals import Array


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
STACK: Final = 32

DEPTH: Final = 512
"""Reversal points that fit: 256 nested loops; beyond, the innermost loop is forgotten."""
SIZE: Final = STACK + 3 * DEPTH

FIELD_LIMIT: Final = 1e7
"""Largest field that the inverse gives [V/m]."""
INVERSE_TOLERANCE: Final = 1e-3
"""Of the accuracy: to which the inverse meets the phase fraction that its target asks for."""

_TWO_BY_SQRT_PI = 2.0 / math.sqrt(math.pi)
_W_TOLERANCE = (
    1e-9  # to which reversal and closure are located: below 1 mV/m of barrier
)
_MARGIN = 0.25  # how far beyond a reversal point an iterate of w may go
_FIELD_RESOLUTION = (
    1e-10  # of the thermal width: field changes below it are rounding, not reversals
)
_SHORTEST = 1e-10  # of the relaxation time: a step so short needs no error control

# Radau IIA with 3 stages: order 5, L-stable, its last stage is the end of the step (Hairer and Wanner II, IV.5, IV.8).
_S6 = math.sqrt(6.0)
_C1, _C2 = (4 - _S6) / 10, (4 + _S6) / 10
_A11, _A12, _A13 = (88 - 7 * _S6) / 360, (296 - 169 * _S6) / 1800, (-2 + 3 * _S6) / 225
_A21, _A22, _A23 = (296 + 169 * _S6) / 1800, (88 + 7 * _S6) / 360, (-2 - 3 * _S6) / 225
_A31, _A32, _A33 = (16 - _S6) / 36, (16 + _S6) / 36, 1 / 9
_D1, _D2, _D3 = (
    -(13 + 7 * _S6) / 3,
    (-13 + 7 * _S6) / 3,
    -1 / 3,
)  # of the embedded error estimate
_REAL_EIGENVALUE = 30 / (6 + 81 ** (1 / 3) - 9 ** (1 / 3))


@njit(cache=True, error_model="numpy")
def evaluate(
    state: Array, m: Material, w: float, field: float
) -> tuple[float, float, float, float, float]:
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

    z = (field - state[CENTRE] - state[SLOPE] * w) / m.thermal_width
    a = abs(z)
    g = erfcx_positive(a)
    e = math.exp(-a * a)
    fast, slow = 1.0 / g, e / (2.0 - e * g)
    up, down = (fast, slow) if z >= 0.0 else (slow, fast)
    f_z = (
        up * (_TWO_BY_SQRT_PI * up - 2.0 * z) * xc
        + down * (_TWO_BY_SQRT_PI * down + 2.0 * z) * x
    )
    f = (up * xc - down * x) / m.relaxation_time
    f_w = (
        -(f_z * state[SLOPE] / m.thermal_width + (up + down) * x_w) / m.relaxation_time
    )
    return x, xc, x_w, f, f_w


@njit(cache=True, error_model="numpy")
def _guess(state: Array, h: float) -> tuple[float, float, float]:
    """Stage values of w to start from: the cubic of the previous step carried on, or no change."""
    w3 = state[W]
    past = state[PAST]
    if not 0.0 < h <= 2.0 * past:
        return w3, w3, w3
    w0, w1, w2 = state[PAST_W], state[PAST_W + 1], state[PAST_W + 2]
    d01 = (w1 - w0) / _C1
    d12 = (w2 - w1) / (_C2 - _C1)
    d23 = (w3 - w2) / (1.0 - _C2)
    d012 = (d12 - d01) / _C2
    d123 = (d23 - d12) / (1.0 - _C1)
    d0123 = d123 - d012
    r = h / past
    s1, s2 = r * _C1, r * _C2
    return (
        w3 + s1 * (d23 + (s1 + 1.0 - _C2) * (d123 + (s1 + 1.0 - _C1) * d0123)),
        w3 + s2 * (d23 + (s2 + 1.0 - _C2) * (d123 + (s2 + 1.0 - _C1) * d0123)),
        w3 + r * (d23 + (r + 1.0 - _C2) * (d123 + (r + 1.0 - _C1) * d0123)),
    )


@njit(cache=True, error_model="numpy")
def limits(state: Array) -> tuple[float, float]:
    """Range of w for iterates: up to saturation, or a little beyond a reversal point."""
    count = state[COUNT]
    saturated_low = count <= 3.0
    saturated_high = count <= 2.0
    low = state[W_LOW] if saturated_low else state[W_LOW] - _MARGIN
    high = state[W_HIGH] if saturated_high else state[W_HIGH] + _MARGIN
    return low, high


@njit(cache=True, error_model="numpy")
def radau(
    state: Array, m: Material, h: float, rate: float
) -> tuple[bool, float, float, float, float]:
    """One Radau IIA step of length h [s] at field rate [V/m/s]: converged, w at the three stages, estimated error of x."""
    low, high = limits(state)
    w1, w2, w3 = _guess(state, h)
    w1, w2, w3 = (
        min(max(w1, low), high),
        min(max(w2, low), high),
        min(max(w3, low), high),
    )
    x0, xc0 = state[X], state[XC]
    upper = x0 > 0.5
    field = state[FIELD]
    field3 = field + h * rate
    field1, field2 = field + _C1 * h * rate, field + _C2 * h * rate
    curvature = 0.5 * (
        state[SLOPE] / m.thermal_width
        + 2.0 * max(abs(state[W_LOW]), abs(state[W_HIGH]))
    )
    for _ in range(8):
        x1, xc1, g1, f1, j1 = evaluate(state, m, w1, field1)
        x2, xc2, g2, f2, j2 = evaluate(state, m, w2, field2)
        x3, xc3, g3, f3, j3 = evaluate(state, m, w3, field3)
        z1, z2, z3 = (
            (xc0 - xc1, xc0 - xc2, xc0 - xc3) if upper else (x1 - x0, x2 - x0, x3 - x0)
        )
        r1 = z1 - h * (_A11 * f1 + _A12 * f2 + _A13 * f3)
        r2 = z2 - h * (_A21 * f1 + _A22 * f2 + _A23 * f3)
        r3 = z3 - h * (_A31 * f1 + _A32 * f2 + _A33 * f3)
        # Newton's matrix diag(dx/dw) - h A diag(df/dw), eliminated from the left column
        k1, k2, k3 = -h * j1, -h * j2, -h * j3
        p1 = 1.0 / (g1 + _A11 * k1)
        l2, l3 = _A21 * k1 * p1, _A31 * k1 * p1
        m22 = g2 + (_A22 - l2 * _A12) * k2
        m23 = (_A23 - l2 * _A13) * k3
        m32 = (_A32 - l3 * _A12) * k2
        m33 = g3 + (_A33 - l3 * _A13) * k3
        s2, s3 = r2 - l2 * r1, r3 - l3 * r1
        p2 = 1.0 / m22
        d3 = (s3 - m32 * p2 * s2) / (m33 - m32 * p2 * m23)
        d2 = (s2 - m23 * d3) * p2
        d1 = (r1 - _A12 * k2 * d2 - _A13 * k3 * d3) * p1
        w1, w2, w3 = (
            min(max(w1 - d1, low), high),
            min(max(w2 - d2, low), high),
            min(max(w3 - d3, low), high),
        )
        # what the next iteration would find left over: residual times relative change of the slope
        largest = max(abs(r1), abs(r2), abs(r3))
        if curvature * max(abs(d1), abs(d2), abs(d3)) * largest < 1e-3 * m.accuracy:
            z1, z2, z3 = z1 - g1 * d1, z2 - g2 * d2, z3 - g3 * d3
            stiffness = min(-state[F_W] / (state[X_W] + 1e-300), -j3 / (g3 + 1e-300))
            error = (state[F] * h + _D1 * z1 + _D2 * z2 + _D3 * z3) / (
                _REAL_EIGENVALUE + h * stiffness
            )
            return True, w1, w2, w3, abs(error)
    return False, w1, w2, w3, math.inf


@njit(cache=True, error_model="numpy")
def backward_euler(state: Array, m: Material, h: float, rate: float) -> float:
    """w after a very short step, by bisection: x - h f rises with w, so this always ends and never passes equilibrium."""
    low, high = limits(state)
    field = state[FIELD] + h * rate
    for _ in range(60):
        w = 0.5 * (low + high)
        x, _, _, f, _ = evaluate(state, m, w, field)
        if x - state[X] > h * f:
            high = w
        else:
            low = w
    return 0.5 * (low + high)


@njit(cache=True, error_model="numpy")
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
    state[W_LOW], state[X_LOW], state[XC_LOW] = w_low, x_low, xc_low
    state[W_HIGH], state[X_HIGH], state[XC_HIGH] = w_high, x_high, xc_high
    state[SHIFT] = shift
    state[STRETCH] = max(span, 0.0) / width if width > 0.0 else 0.0
    state[TAIL_LOW] = tail_low if w_low < 0.0 else whole - tail_low
    state[TAIL_HIGH] = tail_high if w_high >= 0.0 else whole - tail_high
    state[PAST] = 0.0


@njit(cache=True, error_model="numpy")
def refresh(state: Array, m: Material) -> None:
    """Recompute what depends on w and the field."""
    state[X], state[XC], state[X_W], state[F], state[F_W] = evaluate(
        state, m, state[W], state[FIELD]
    )


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def room(state: Array, w: float) -> float:
    """Distance in w left to the reversal point ahead; a saturation point is never reached."""
    if state[COUNT] < 4.0:
        return math.inf
    return state[W_HIGH] - w if state[DIRECTION] > 0.0 else w - state[W_LOW]


@njit(cache=True, error_model="numpy")
def close_loop(state: Array, m: Material) -> None:
    """The loop is closed: forget its two reversal points and go on along the branch that it interrupted."""
    w = state[W_HIGH] if state[DIRECTION] > 0.0 else state[W_LOW]
    state[COUNT] -= 2.0
    state[CLOSURES] += 1.0
    follow_branch(state, m)
    state[W] = w
    refresh(state, m)


@njit(cache=True, error_model="numpy")
def _ahead(state: Array, m: Material, w: float, field: float, reversal: bool) -> float:
    """Distance in w to the event: to equilibrium, where the branch turns, or to the reversal point that closes the loop."""
    if not reversal:
        return room(state, w)
    _, _, _, f, f_w = evaluate(state, m, w, field)
    return state[DIRECTION] * f / (abs(f_w) + 1e-300)


@njit(cache=True, error_model="numpy")
def locate(
    state: Array, m: Material, rate: float, h: float, w: float, reversal: bool
) -> tuple[float, float]:
    """Length of the step that ends just before the event, and w there; a step of h to w is known to pass it."""
    before, w_before, ahead_before = (
        0.0,
        state[W],
        _ahead(state, m, state[W], state[FIELD], reversal),
    )
    after, ahead_after = h, _ahead(state, m, w, state[FIELD] + h * rate, reversal)
    weight_before = weight_after = (
        1.0  # the Illinois rule: an end that stays put pulls less, so both ends move
    )
    for _ in range(100):
        if ahead_before <= _W_TOLERANCE or after - before <= 1e-14 * h:
            break
        pull = weight_before * ahead_before
        middle = before + (after - before) * pull / (pull - weight_after * ahead_after)
        if not before < middle < after:
            middle = 0.5 * (before + after)
        solved, _, _, w_middle, _ = radau(state, m, middle, rate)
        ahead = (
            _ahead(state, m, w_middle, state[FIELD] + middle * rate, reversal)
            if solved
            else -1.0
        )
        if ahead >= 0.0:
            before, w_before, ahead_before = middle, w_middle, ahead
            weight_before, weight_after = 1.0, 0.5 * weight_after
        else:
            after, ahead_after = middle, ahead
            weight_before, weight_after = 0.5 * weight_before, 1.0
    return before, w_before


@njit(cache=True, error_model="numpy")
def _try_steps(
    state: Array, m: Material, rate: float, longest: float
) -> tuple[float, float]:
    """Length and final w of the longest step that meets the accuracy; leaves its successor's length in the state."""
    proposed = state[STEP]
    h = min(longest, proposed)
    while True:
        solved, w1, w2, w3, error = radau(state, m, h, rate)
        if solved and error <= m.accuracy:
            break
        if h <= _SHORTEST * m.relaxation_time:
            w1 = w2 = w3 = backward_euler(state, m, h, rate)
            error = 0.0
            break
        h *= (
            max(0.1, 0.9 * math.sqrt(math.sqrt(m.accuracy / error))) if solved else 0.25
        )
        proposed = h
    growth = (
        5.0
        if 1300.0 * error <= m.accuracy
        else 0.9 * math.sqrt(math.sqrt(m.accuracy / error))
    )
    state[STEP] = max(proposed, growth * h) if h == longest else growth * h
    state[PAST] = h
    state[PAST_W], state[PAST_W + 1], state[PAST_W + 2] = state[W], w1, w2
    return h, w3


@njit(cache=True, error_model="numpy")
def _move(state: Array, m: Material, rate: float, h: float, w: float) -> None:
    state[FIELD] += h * rate
    state[W] = w
    refresh(state, m)


@njit(cache=True, error_model="numpy")
def integrate(
    state: Array, m: Material, rate: float, longest: float, against: bool
) -> float:
    """Go on by at most `longest` [s], up to the next event and through it; returns the time gone [s].

    `against`: the field moves, so that a branch of the other direction can turn.
    """
    turning = against and state[DIRECTION] * rate < 0.0
    if room(state, state[W]) <= 0.0:
        close_loop(state, m)
        return 0.0
    if turning and _ahead(state, m, state[W], state[FIELD], True) <= _W_TOLERANCE:
        reverse(state, m)
        return 0.0
    h, w = _try_steps(state, m, rate, longest)
    if turning and _ahead(state, m, w, state[FIELD] + h * rate, True) < 0.0:
        before, w_before = locate(state, m, rate, h, w, True)
        if room(state, w_before) >= 0.0:
            _move(state, m, rate, before, w_before)
            reverse(state, m)
            return before
        h, w = before, w_before
    if room(state, w) < 0.0:
        h, w = locate(state, m, rate, h, w, False)
        _move(state, m, rate, h, w)
        close_loop(state, m)
        return h
    _move(state, m, rate, h, w)
    return h


@njit(cache=True, error_model="numpy")
def jump(state: Array, m: Material, field: float) -> None:
    """An instantaneous change of field: x and barrier stay, and the branch turns if the field now drives it back."""
    change = field - state[FIELD]
    state[FIELD] = field
    state[PAST] = 0.0
    refresh(state, m)
    against = state[DIRECTION] * change < -_FIELD_RESOLUTION * m.thermal_width
    if against and state[DIRECTION] * state[F] < 0.0:
        reverse(state, m)


@njit(cache=True, error_model="numpy")
def advance(state: Array, m: Material, time: float, field: float) -> None:
    """Go on to `time` [s] along the straight line to `field` [V/m]; no time left means a jump of the field."""
    duration = time - state[TIME]
    change = field - state[FIELD]
    if duration <= 0.0:
        jump(state, m, field)
        return
    rate = change / duration
    against = abs(change) > _FIELD_RESOLUTION * m.thermal_width
    left = duration
    while left > 0.0:
        left -= integrate(state, m, rate, left, against)
    state[TIME], state[FIELD], state[RATE] = time, field, rate


@njit(cache=True, error_model="numpy")
def polarization(state: Array, m: Material) -> float:
    """P = E/E1 + (2x - 1) P_T [C/m^2] (3.20)."""
    return (
        state[FIELD] / m.reciprocal_permittivity
        + (state[X] - state[XC]) * m.domain_polarization
    )


@njit(cache=True, error_model="numpy")
def run(
    state: Array, m: Material, time: Array, voltage: Array, p: Array, x: Array
) -> None:
    """Step through a block: fills polarization `p` and phase fraction `x` [every array: shape (n,)]; changes `state`."""
    for i in range(time.size):
        advance(state, m, time[i], voltage[i] / m.layer_thickness)
        p[i] = polarization(state, m)
        x[i] = min(max(state[X], 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _trial(state: Array, saved: Array, m: Material, time: float, field: float) -> float:
    """P at `time` if the field went straight to `field` from the `saved` state; leaves the outcome in `state`."""
    if state[REVERSALS] != saved[REVERSALS] or state[CLOSURES] != saved[CLOSURES]:
        state[STACK:] = saved[STACK:]
    state[:STACK] = saved[:STACK]
    advance(state, m, time, field)
    return polarization(state, m)


@njit(cache=True, error_model="numpy")
def susceptibility(state: Array, m: Material, duration: float) -> float:
    """Roughly dP/dE [F/m] over a step of `duration` [s]: a linear implicit step, for the first guess in a block."""
    weight = -0.5 * max(duration, 0.0) * state[F_W]
    switching = weight * state[X_W] / (state[SLOPE] * (state[X_W] + weight + 1e-300))
    return 1.0 / m.reciprocal_permittivity + 2.0 * m.domain_polarization * switching


@njit(cache=True, error_model="numpy")
def run_inverse(
    state: Array, m: Material, time: Array, p: Array, voltage: Array, x: Array
) -> int:
    """Fill `voltage` so that `run` on it gives the polarization `p` [every array: shape (n,)]; changes `state` as `run` would.

    P rises with the field at the end of the step, so each sample is a scalar equation for that field: secant steps from
    the extrapolated field, inside a bracket. Out of reach within FIELD_LIMIT, the limit is taken; a target that is no
    number keeps the field. Returns the number of model steps taken.
    """
    tolerance = INVERSE_TOLERANCE * m.accuracy * m.domain_polarization
    saved = state.copy()
    steps = 0
    slope = susceptibility(state, m, time[0] - state[TIME]) if time.size else 0.0
    for i in range(time.size):
        duration = max(time[i] - saved[TIME], 0.0)
        low, high = -FIELD_LIMIT, FIELD_LIMIT
        field = saved[FIELD] + saved[RATE] * duration
        old_field = old_excess = 0.0
        for n in range(80):
            # through the voltage, so that `run` on it sees the same field to the bit
            field = (
                min(max(field, -FIELD_LIMIT), FIELD_LIMIT)
                * m.layer_thickness
                / m.layer_thickness
            )
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
        if state[REVERSALS] != saved[REVERSALS] or state[CLOSURES] != saved[CLOSURES]:
            saved[STACK:] = state[STACK:]
        saved[:STACK] = state[:STACK]
    return steps


@njit(cache=True)
def fresh_state(m: Material, saturation_barrier: float) -> Array:
    """Negatively saturated at time 0 and field 0: x = 0, B = -B_sat, ascending."""
    state = np.zeros(SIZE)
    state[STACK : STACK + 6] = np.array(
        [1.0, 0.0, saturation_barrier, 0.0, 1.0, -saturation_barrier]
    )
    state[COUNT] = 2.0
    state[STEP] = math.inf
    follow_branch(state, m)
    state[W] = state[W_LOW]
    refresh(state, m)
    return state
