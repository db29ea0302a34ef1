"""Time stepping of the parametrized model with one distribution, and its inverse: compiled, implicit.

Kvaerno's ESDIRK method of order 3 (BIT 44, 2004, his ESDIRK 3/2): L-stable, so that fronts may be as stiff as they
like, and its stages are one scalar equation each. That rises with the barrier, so the root is unique and bracketed.
The difference of the last two stages, of orders 2 and 3, is the error estimate.

With coercive fields only, domains switch up in fields above 0 and down below it: a branch begins where the field
passes 0. Energy is then dissipated at every instant, E dx >= 0. (Were the rate back over the new barrier admitted,
which is 0 there, all that has switched would fall back at the rate 1/tau as long as the field is small.)
"""

from __future__ import annotations

import math
from typing import Any

from pzt_ros.physics.parametrized_single_branch import (
    BASE,
    CHANGES,
    COERCIVE,
    DIRECTION,
    FIELD,
    HARDEST,
    STACK,
    STEEPNESS,
    STEP,
    TAKEN,
    TIME,
    W_END,
    F,
    Material,
    W,
    X,
    close_loop,
    compiled,
    evaluate,
    polarization,
    refresh,
    turn,
)
from pzt_ros.physics.signals import Array

_G = 0.43586652150845899942  # the root of g^3 - 3 g^2 + 3 g/2 - 1/6 in (1/6, 1/2): L-stable
_A31, _A32 = (-4 * _G * _G + 6 * _G - 1) / (4 * _G), (1 - 2 * _G) / (4 * _G)
_B1, _B2 = (6 * _G - 1) / (12 * _G), -1 / ((24 * _G - 12) * _G)
_B3 = (-6 * _G * _G + 6 * _G - 1) / (6 * _G - 3)

_NEWTON_SHARE = 1e-3  # of the accuracy, left to the solution of the implicit equations
_SHORTEST = 1e-12  # of the relaxation time: a step so short is as good as any
_W_TOLERANCE = 1e-9  # to which the closure of a loop is located: 1 mV/m of barrier

FIELD_LIMIT = 1e7
"""Largest field that the inverse gives [V/m]."""
_TARGET_SHARE = 1e-4  # of the accuracy: to which the inverse meets the phase fraction that its target asks for


@compiled
def _stage(
    m: Material, known: float, weight: float, w: float, field: float, taken: float
) -> tuple[float, float, float, float]:
    """w, share, f and residual of one stage, share(w) = known + weight f(w), by Newton's method inside a bracket."""
    low, high = m.lowest, HARDEST
    share = f = residual = 0.0
    for _ in range(100):
        share, share_w, f, f_w = evaluate(m, w, field, taken)
        residual = share - known - weight * f
        if abs(residual) <= _NEWTON_SHARE * m.accuracy or high - low <= 1e-15:
            break
        if residual > 0.0:
            high = w
        else:
            low = w
        w -= residual / (share_w - weight * f_w)
        if not low < w < high:
            w = 0.5 * (low + high)
    return w, share, f, abs(residual)


@compiled
def attempt(state: Array, m: Material, h: float, rate: float) -> tuple[float, float, float, float]:
    """One step of length h [s] at a field rate [V/m/s]: w, share and f at its end, and the estimated error of x."""
    taken, direction = state[TAKEN], state[DIRECTION]
    field, per_second = direction * state[FIELD], direction * rate
    share, f1, weight = direction * (state[X] - state[BASE]), state[F], _G * h
    w2, _, f2, missed2 = _stage(m, share + weight * f1, weight, state[W], field + 2.0 * weight * per_second, taken)
    end = field + h * per_second
    w3, before, f3, missed3 = _stage(m, share + h * (_A31 * f1 + _A32 * f2), weight, w2, end, taken)
    w, after, f, missed = _stage(m, share + h * (_B1 * f1 + _B2 * f2 + _B3 * f3), weight, w3, end, taken)
    # after too long a step the stages ask for more than all domains and agree in that: then they have a residual
    return w, after, f, abs(after - before) + missed + missed2 + missed3


@compiled
def _locate(state: Array, m: Material, h: float, w: float, rate: float) -> float:
    """Length of the step that closes the loop, if one of length h to w goes beyond: secants, by the Illinois rule."""
    before, after = 0.0, h
    short, over = state[W_END] - state[W], w - state[W_END]
    if short <= _W_TOLERANCE:  # the inner loop and this one close together
        return 0.0
    for _ in range(100):
        middle = before + (after - before) * short / (short + over)
        if not before < middle < after:
            break
        missed = attempt(state, m, middle, rate)[0] - state[W_END]
        if abs(missed) <= _W_TOLERANCE:
            return middle
        if missed < 0.0:
            before, short, over = middle, -missed, 0.5 * over
        else:
            after, over, short = middle, missed, 0.5 * short
    return after


@compiled
def _integrate(state: Array, m: Material, rate: float, longest: float) -> float:
    """Go on by one internal step of at most `longest` [s], or up to the end of the loop; returns the time gone [s]."""
    proposed = state[STEP]
    h = min(longest, proposed)
    while True:
        w, share, f, error = attempt(state, m, h, rate)
        growth = min(5.0, 0.9 * (m.accuracy / error) ** (1.0 / 3.0)) if error > 0.0 else 5.0
        if error <= m.accuracy or h <= _SHORTEST * m.relaxation_time:
            break
        h = proposed = max(0.1, growth) * h
    state[STEP] = max(proposed, growth * h) if h == longest else growth * h
    if w >= state[W_END]:
        h = _locate(state, m, h, w, rate)
        state[FIELD] += h * rate
        close_loop(state, m)
        return h
    state[FIELD] += h * rate
    state[W], state[F] = w, f
    state[X] = state[BASE] + state[DIRECTION] * share
    return h


@compiled
def _ramp(state: Array, m: Material, duration: float, field: float) -> None:
    """Go on to a field [V/m] within a duration [s]; between them it does not change its sign."""
    start = state[FIELD]
    if m.distribution == COERCIVE and state[DIRECTION] * (start + field) < 0.0:
        turn(state, m)
    rate, left = (field - start) / duration, duration
    while left > 0.0:
        left -= _integrate(state, m, rate, left)
    state[FIELD] = field


@compiled
def advance(state: Array, m: Material, time: float, field: float) -> None:
    """Go on to `time` [s] along the straight line to `field` [V/m]; no time left means a jump of the field."""
    duration, start = time - state[TIME], state[FIELD]
    if duration <= 0.0:
        state[FIELD] = field
        refresh(state, m)
        return
    if start * field < 0.0:
        first = duration * start / (start - field)
        if first > 0.0:
            _ramp(state, m, first, 0.0)
        duration -= first
    if duration > 0.0:
        _ramp(state, m, duration, field)
    state[TIME], state[FIELD] = time, field


@compiled
def run(state: Array, numbers: tuple[Any, ...], time: Array, voltage: Array, p: Array, x: Array) -> None:
    """Step through a block: fills polarization `p` and phase fraction `x` [all of shape (n,)]; changes `state`.

    The `numbers` are those of a Material; from Python a plain tuple is taken in a third of the time of a named one.
    """
    m = Material(*numbers)
    for i in range(time.size):
        advance(state, m, time[i], voltage[i] / m.layer_thickness)
        p[i] = polarization(state, m)
        x[i] = state[X]


@compiled
def _copy(source: Array, target: Array) -> None:
    """Copy a state; the stack only where it differs."""
    last = source.size if source[CHANGES] != target[CHANGES] else STACK
    for i in range(last):
        target[i] = source[i]


@compiled
def run_inverse(state: Array, numbers: tuple[Any, ...], time: Array, p: Array, voltage: Array, x: Array) -> None:
    """Fill `voltage` so that `run` on it gives the polarization `p` [all of shape (n,)]; `state` changes as in `run`.

    P rises with the field at the end of the step: secants inside a bracket, bisection where they leave it or linger.
    Where FIELD_LIMIT does not suffice, the limit is taken; a target that is no number keeps the field.
    """
    m = Material(*numbers)
    tolerance = _TARGET_SHARE * m.accuracy * m.domain_polarization
    trial, least = state.copy(), 1.0 / m.reciprocal_permittivity
    for i in range(time.size):
        start, way, known = state[FIELD], p[i] - polarization(state, m), not math.isnan(p[i])
        low, high, slope = -FIELD_LIMIT, FIELD_LIMIT, max(state[STEEPNESS], least)
        field = start + way / slope if known else start
        old_field = old_excess = 0.0
        for n in range(120):
            # through the voltage, so that `run` on it sees the same field to the bit
            field = min(max(field, low), high) * m.layer_thickness / m.layer_thickness
            _copy(state, trial)
            advance(trial, m, time[i], field)
            excess = polarization(trial, m) - p[i]
            if not abs(excess) > tolerance or high - low <= 1e-15 * FIELD_LIMIT:
                break
            low, high = (low, field) if excess > 0.0 else (field, high)
            if n > 0 and (excess - old_excess) * (field - old_field) > 0.0:
                slope = max((excess - old_excess) / (field - old_field), least)
            old_field, old_excess = field, excess
            field -= excess / slope
            lingers = n > 8 and n % 2 == 0
            at_a_limit = field <= -FIELD_LIMIT == low or field >= FIELD_LIMIT == high
            if lingers or (not low < field < high and not at_a_limit):
                field = 0.5 * (low + high)
        if known and abs(trial[FIELD] - start) > 1e-9 * FIELD_LIMIT:
            trial[STEEPNESS] = max((way + excess) / (trial[FIELD] - start), least)
        _copy(trial, state)
        voltage[i] = state[FIELD] * m.layer_thickness
        x[i] = state[X]
