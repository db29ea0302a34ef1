"""Time stepping of the parametrized model: compiled, implicit, with reversals and closures located inside a step.

Two methods share the work. BDF2 costs one evaluation and serves where its error is far below the accuracy, which is
nearly always at 20 kHz; the 3-stage Radau IIA method does the rest: fronts, steps after an event, rows far apart.

Where E(t) is linear, dx/dt = f on an ascending branch can fall through zero only while E falls, and then once: at f = 0
its time derivative is (df/dE) dE/dt. So a branch turns only against the field, which rules chatter out by construction.
"""

from __future__ import annotations

import math

from pzt_ros.physics.parametrized_branch import (
    DIRECTION,
    F_W,
    FIELD,
    PAST,
    PAST_GAIN,
    PAST_MISS,
    PAST_W,
    RATE,
    STEEPNESS,
    STEP,
    TIME,
    W_HIGH,
    W_LOW,
    X_W,
    XC,
    F,
    Material,
    W,
    X,
    close_loop,
    compiled,
    evaluate,
    inlined,
    limits,
    polarization,
    refresh,
    reverse,
    room,
)
from pzt_ros.physics.signals import Array

_W_TOLERANCE = 1e-9  # to which reversal and closure are located: below 1 mV/m of barrier
_FIELD_RESOLUTION = 1e-10  # of the thermal width: field changes below it are rounding, not reversals
_SHORTEST = 1e-10  # of the relaxation time: a step so short needs no error control
_NEWTON_SHARE = 1e-3  # of the accuracy, left to the solution of the implicit equations
_FAST_SHARE = 0.25  # of the accuracy: missing the quadratic prediction by this, BDF2 errs by 0.1
_BARRIER_SHARE = 1e-3  # of the thermal width: error of the barrier that counts as much as one of x by the accuracy
_UNKNOWN = math.inf
_TINY = 1e-200  # far out in a tail nothing moves: 0/0 shall be 0

# Radau IIA with 3 stages: order 5, L-stable, its last stage is the end of the step (Hairer and Wanner II, IV.5, IV.8).
_S6 = math.sqrt(6.0)
_C1, _C2 = (4 - _S6) / 10, (4 + _S6) / 10
# divided differences over 0, C1, C2, 1
_BY_C1, _BY_C2, _BY_C12, _BY_C13, _BY_C23 = 1 / _C1, 1 / _C2, 1 / (_C2 - _C1), 1 / (1 - _C1), 1 / (1 - _C2)
_A11, _A12, _A13 = (88 - 7 * _S6) / 360, (296 - 169 * _S6) / 1800, (-2 + 3 * _S6) / 225
_A21, _A22, _A23 = (296 + 169 * _S6) / 1800, (88 + 7 * _S6) / 360, (-2 - 3 * _S6) / 225
_A31, _A32, _A33 = (16 - _S6) / 36, (16 + _S6) / 36, 1 / 9
_D1, _D2, _D3 = (
    -(13 + 7 * _S6) / 3,
    (-13 + 7 * _S6) / 3,
    -1 / 3,
)  # of the embedded error estimate
_REAL_EIGENVALUE = 30 / (6 + 81 ** (1 / 3) - 9 ** (1 / 3))


@compiled
def gain(state: Array, end: tuple[float, float, float, float, float]) -> float:
    """Rise of x from the present point to one given by `evaluate`, from whichever of x and 1 - x is smaller."""
    return state[XC] - end[1] if state[X] > 0.5 else end[0] - state[X]


@compiled
def weighed(state: Array, m: Material, x_error: float, w_error: float) -> float:
    """The larger of two errors, in terms of x: in a tail x hardly knows the barrier, but the memory does."""
    per_w = m.accuracy / _BARRIER_SHARE * state[STEEPNESS]
    return max(abs(x_error), per_w * abs(w_error))


@compiled
def miss(state: Array, h: float, end: tuple[float, float, float, float, float]) -> float:
    """How far a step of length h [s] ends from the parabola through the last two points with the present slope."""
    past = state[PAST]
    if past <= 0.0:
        return _UNKNOWN
    ratio = h / past
    return abs(gain(state, end) - h * state[F] - ratio * ratio * (past * state[F] - state[PAST_GAIN]))


@compiled
def curvature(state: Array) -> float:
    """Relative change of the slopes dx/dw and df/dw per change of w, halved as in Taylor's series: a bound."""
    return 0.5 * state[STEEPNESS] + max(abs(state[W_LOW]), abs(state[W_HIGH]))


@inlined
def _guess(state: Array, h: float) -> tuple[float, float, float]:
    """Stage values of w to start from: the cubic of the previous step carried on, or no change."""
    w3 = state[W]
    past = state[PAST]
    if not 0.0 < h <= 2.0 * past:
        return w3, w3, w3
    w0, w1, w2 = state[PAST_W], state[PAST_W + 1], state[PAST_W + 2]
    d01 = (w1 - w0) * _BY_C1
    d12 = (w2 - w1) * _BY_C12
    d23 = (w3 - w2) * _BY_C23
    d012 = (d12 - d01) * _BY_C2
    d123 = (d23 - d12) * _BY_C13
    d0123 = d123 - d012
    r = h / past
    s1, s2 = r * _C1, r * _C2
    return (
        w3 + s1 * (d23 + (s1 + 1.0 - _C2) * (d123 + (s1 + 1.0 - _C1) * d0123)),
        w3 + s2 * (d23 + (s2 + 1.0 - _C2) * (d123 + (s2 + 1.0 - _C1) * d0123)),
        w3 + r * (d23 + (r + 1.0 - _C2) * (d123 + (r + 1.0 - _C1) * d0123)),
    )


@compiled
def radau(state: Array, m: Material, h: float, rate: float) -> tuple[bool, float, float, float, float]:
    """One Radau IIA step of length h [s] at `rate` [V/m/s]: converged, w at the three stages, estimated error of x."""
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
    bend = curvature(state)
    for _ in range(8):
        x1, xc1, g1, f1, j1 = evaluate(state, m, w1, field1)
        x2, xc2, g2, f2, j2 = evaluate(state, m, w2, field2)
        x3, xc3, g3, f3, j3 = evaluate(state, m, w3, field3)
        z1, z2, z3 = (xc0 - xc1, xc0 - xc2, xc0 - xc3) if upper else (x1 - x0, x2 - x0, x3 - x0)
        r1 = z1 - h * (_A11 * f1 + _A12 * f2 + _A13 * f3)
        r2 = z2 - h * (_A21 * f1 + _A22 * f2 + _A23 * f3)
        r3 = z3 - h * (_A31 * f1 + _A32 * f2 + _A33 * f3)
        # Newton's matrix diag(dx/dw) - h A diag(df/dw), eliminated from the left column
        k1, k2, k3 = -h * j1, -h * j2, -h * j3
        p1 = 1.0 / (g1 + _A11 * k1 + _TINY)
        l2, l3 = _A21 * k1 * p1, _A31 * k1 * p1
        m22 = g2 + (_A22 - l2 * _A12) * k2
        m23 = (_A23 - l2 * _A13) * k3
        m32 = (_A32 - l3 * _A12) * k2
        m33 = g3 + (_A33 - l3 * _A13) * k3
        s2, s3 = r2 - l2 * r1, r3 - l3 * r1
        p2 = 1.0 / (m22 + _TINY)
        d3 = (s3 - m32 * p2 * s2) / (m33 - m32 * p2 * m23 + _TINY)
        d2 = (s2 - m23 * d3) * p2
        d1 = (r1 - _A12 * k2 * d2 - _A13 * k3 * d3) * p1
        d1 = w1 - min(max(w1 - d1, low), high)
        d2 = w2 - min(max(w2 - d2, low), high)
        d3 = w3 - min(max(w3 - d3, low), high)
        w1, w2, w3 = w1 - d1, w2 - d2, w3 - d3
        # what the next iteration would find left over: residual times relative change of the slope
        largest = max(abs(r1), abs(r2), abs(r3))
        relative = bend * max(abs(d1), abs(d2), abs(d3))
        if (
            weighed(state, m, relative * largest, relative * max(abs(d1), abs(d2), abs(d3)))
            < _NEWTON_SHARE * m.accuracy
        ):
            z1, z2, z3 = z1 - g1 * d1, z2 - g2 * d2, z3 - g3 * d3
            # the less stiff end of the step filters the estimate, its end turns it into w
            defect = state[F] * h + _D1 * z1 + _D2 * z2 + _D3 * z3
            stiffness = min(-state[F_W] / (state[X_W] + _TINY), -j3 / (g3 + _TINY))
            w_error = min(abs(defect / (_REAL_EIGENVALUE * g3 - h * j3 + _TINY)), abs(w3 - state[W]))
            return True, w1, w2, w3, weighed(state, m, defect / (_REAL_EIGENVALUE + h * stiffness), w_error)
    return False, w1, w2, w3, math.inf


@inlined
def bdf2(
    state: Array, m: Material, h: float, rate: float
) -> tuple[bool, float, float, tuple[float, float, float, float, float]]:
    """One BDF2 step of length h [s], given the step before: accurate enough, w at its end, `miss` and `evaluate` there.

    The end is carried on from the last iterate by Taylor's series: what that leaves out is less than what Newton's
    method does, and one evaluation will mostly do.
    """
    low, high = limits(state)
    _, _, w = _guess(state, h)
    w = min(max(w, low), high)
    field = state[FIELD] + h * rate
    ratio = h / state[PAST]
    share = 1.0 / (1.0 + 2.0 * ratio)
    carried = ratio * ratio * share * state[PAST_GAIN]
    weight = (1.0 + ratio) * share * h
    bend = curvature(state)
    for _ in range(4):
        end = evaluate(state, m, w, field)
        x, xc, x_w, f, f_w = end
        residual = gain(state, end) - carried - weight * f
        per_w = x_w - weight * f_w + _TINY
        change = -residual / per_w
        relative = bend * abs(change)
        if not low <= w + change <= high:
            break
        if weighed(state, m, relative * residual, relative * change) <= _NEWTON_SHARE * m.accuracy:
            rise = x_w * change * (1.0 - w * change)
            end = x + rise, xc - rise, x_w * (1.0 - 2.0 * w * change), f + f_w * change, f_w
            missed = miss(state, h, end)
            return weighed(state, m, missed, missed / per_w) <= _FAST_SHARE * m.accuracy, w + change, missed, end
        w += change
    return False, w, math.inf, end


@compiled
def backward_euler(state: Array, m: Material, h: float, rate: float) -> float:
    """w after a very short step, by bisection: x - h f rises with w, so this always ends short of equilibrium."""
    low, high = limits(state)
    field = state[FIELD] + h * rate
    for _ in range(60):
        w = 0.5 * (low + high)
        end = evaluate(state, m, w, field)
        if gain(state, end) > h * end[3]:
            high = w
        else:
            low = w
    return 0.5 * (low + high)


@compiled
def _ahead(state: Array, m: Material, w: float, field: float, reversal: bool) -> float:
    """Distance in w to the event: equilibrium, where the branch turns, or the reversal point that ends the loop."""
    if not reversal:
        return room(state, w)
    _, _, _, f, f_w = evaluate(state, m, w, field)
    return state[DIRECTION] * f / (abs(f_w) + _TINY)


@compiled
def locate(state: Array, m: Material, rate: float, h: float, w: float, reversal: bool) -> tuple[float, float]:
    """Length of the step that ends just before the event, and w there; a step of h to w is known to pass it."""
    before, w_before, ahead_before = (
        0.0,
        state[W],
        _ahead(state, m, state[W], state[FIELD], reversal),
    )
    after, ahead_after = h, _ahead(state, m, w, state[FIELD] + h * rate, reversal)
    weight_before = weight_after = 1.0  # the Illinois rule: an end that stays put pulls less, so both ends move
    for _ in range(100):
        if ahead_before <= _W_TOLERANCE or after - before <= 1e-14 * h:
            break
        pull = weight_before * ahead_before
        middle = before + (after - before) * pull / (pull - weight_after * ahead_after)
        if not before < middle < after:
            middle = 0.5 * (before + after)
        solved, _, _, w_middle, _ = radau(state, m, middle, rate)
        ahead = _ahead(state, m, w_middle, state[FIELD] + middle * rate, reversal) if solved else -1.0
        if ahead >= 0.0:
            before, w_before, ahead_before = middle, w_middle, ahead
            weight_before, weight_after = 1.0, 0.5 * weight_after
        else:
            after, ahead_after = middle, ahead
            weight_before, weight_after = 0.5 * weight_before, 1.0
    return before, w_before


@compiled
def _radau_steps(state: Array, m: Material, rate: float, longest: float) -> tuple[float, float, float, float]:
    """Length of the longest step that meets the accuracy, and w at its stages; the state learns what to try next."""
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
        h *= max(0.1, 0.9 * math.sqrt(math.sqrt(m.accuracy / error))) if solved else 0.25
        proposed = h
    growth = 5.0 if 1300.0 * error <= m.accuracy else 0.9 * math.sqrt(math.sqrt(m.accuracy / error))
    state[STEP] = max(proposed, growth * h) if h == longest else growth * h
    return h, w1, w2, w3


@compiled
def _accept(
    state: Array,
    h: float,
    rate: float,
    missed: float,
    w1: float,
    w2: float,
    w3: float,
    end: tuple[float, float, float, float, float],
) -> None:
    """Make the end of a step the present point, and the step the past."""
    state[PAST_MISS] = missed
    state[PAST_GAIN] = gain(state, end)
    state[PAST] = h
    state[PAST_W], state[PAST_W + 1], state[PAST_W + 2] = state[W], w1, w2
    state[FIELD] += h * rate
    state[W] = w3
    state[X], state[XC], state[X_W], state[F], state[F_W] = end


@inlined
def _fast_step(state: Array, m: Material, rate: float, h: float) -> bool:
    """Take one BDF2 step if it is good enough and closes no loop."""
    past = state[PAST]
    if state[PAST_MISS] > _FAST_SHARE * m.accuracy or not 0.5 * past <= h <= 2.0 * past or h > state[STEP]:
        return False
    good, w, missed, end = bdf2(state, m, h, rate)
    if not good or room(state, w) < 0.0:
        return False
    w0 = state[W]
    before, behind = (w0 - state[PAST_W]) / past, (w - w0) / h
    bend = (behind - before) / (h + past)  # the parabola through the last three points stands in for the stages
    w1 = w0 + _C1 * h * (behind - (1.0 - _C1) * h * bend)
    w2 = w0 + _C2 * h * (behind - (1.0 - _C2) * h * bend)
    _accept(state, h, rate, missed, w1, w2, w, end)
    return True


@inlined
def integrate(state: Array, m: Material, rate: float, longest: float, against: bool) -> float:
    """Go on by at most `longest` [s], up to the next event and through it; returns the time gone [s].

    `against`: the field moves, so that a branch of the other direction can turn.
    """
    if room(state, state[W]) <= 0.0:
        close_loop(state, m)
        return 0.0
    turning = against and state[DIRECTION] * rate < 0.0
    if turning:
        if state[DIRECTION] * state[F] <= -_W_TOLERANCE * state[F_W]:
            reverse(state, m)
            return 0.0
    elif _fast_step(state, m, rate, longest):
        return longest
    h, w1, w2, w = _radau_steps(state, m, rate, longest)
    end = evaluate(state, m, w, state[FIELD] + h * rate)
    turns = turning and state[DIRECTION] * end[3] < 0.0
    if turns:
        h, w = locate(state, m, rate, h, w, True)
    closes = room(state, w) < 0.0
    if closes:
        h, w = locate(state, m, rate, h, w, False)
    if not (turns or closes):
        _accept(state, h, rate, miss(state, h, end), w1, w2, w, end)
        return h
    state[FIELD] += h * rate
    state[W] = w
    if closes:
        close_loop(state, m)
    else:
        refresh(state, m)
        reverse(state, m)
    return h


@compiled
def jump(state: Array, m: Material, field: float) -> None:
    """An instantaneous change of field: x and barrier stay, and the branch turns if the field now drives it back."""
    change = field - state[FIELD]
    state[FIELD] = field
    state[PAST] = 0.0
    refresh(state, m)
    against = state[DIRECTION] * change < -_FIELD_RESOLUTION * m.thermal_width
    if against and state[DIRECTION] * state[F] < 0.0:
        reverse(state, m)


@inlined
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


@compiled
def run(state: Array, numbers: tuple[float, ...], time: Array, voltage: Array, p: Array, x: Array) -> None:
    """Step through a block: fills polarization `p` and phase fraction `x` [all of shape (n,)]; changes `state`.

    The `numbers` are those of a Material; from Python a plain tuple is taken in a third of the time of a named one.
    """
    m = Material(*numbers)
    for i in range(time.size):
        advance(state, m, time[i], voltage[i] / m.layer_thickness)
        p[i] = polarization(state, m)
        x[i] = min(max(state[X], 0.0), 1.0)
