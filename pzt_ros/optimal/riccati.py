"""The structured solver, compiled: Gauss-Newton by a Riccati recursion over (x+, E) with bounds, exact in their place.

One iteration: backwards over the horizon, the quadratic model of the cost gives for every field the best step and how
it answers to changes before it; a field that its bounds hold back follows the bound instead, and the steps before it
know that (so no clipping after the fact, which costs 26 to 40 %: methods.md 4). Then forwards through the model with
these laws. P is linear in (x+, E), so the Gauss-Newton model neglects nothing but the curvature of the dynamics.
Control-limited differential dynamic programming (Tassa, Mansard, Todorov, ICRA 2014) with bounds that may move.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from pzt_ros.optimal.interval import (
    BY_LEFT,
    BY_RIGHT,
    BY_X,
    FEED,
    FIELD,
    GAIN_LEFT,
    GAIN_X,
    STAGE,
    X,
    collocate,
)
from pzt_ros.optimal.law import NUMBERS, Material, compiled
from pzt_ros.optimal.radau import NODES, STAGES, WEIGHTS
from pzt_ros.physics.compiling import WITHIN
from pzt_ros.physics.signals import Array

_C = tuple(float(c) for c in NODES)
_B = tuple(float(b) for b in WEIGHTS)
_SHORTENINGS = 6  # of a step that does not lower the cost, before the curvature is raised
_NO_GAIN = 1e-12  # of the cost: a step so useless ends the search
_CORRECTIONS = 4  # of a field that the current holds back; the charge is almost linear in it


class Numbers(NamedTuple):
    """Of a problem, as the compiled loops take them; SI, absent limits infinite."""

    h: float  # length of an interval [s]
    lowest: float  # field [V/m]
    highest: float
    step: float  # largest change of the field over an interval [V/m]
    charge: float  # largest change of the polarization over an interval [C/m^2]
    initial_field: float  # [V/m]; NaN: free
    rate_weight: float  # of the squared field rate
    end_weight: float  # of the squared miss at the end [s]


@njit(**WITHIN)
def _law_of_field(q_u: float, q_uu: float, step: float, low: float, high: float) -> tuple[float, int]:
    """The best step within [low, high], and which of the two holds it (-1, 0, 1)."""
    step = -q_u / q_uu if q_uu > 0.0 else step
    if step >= high:
        return high, 1
    if step <= low:
        return low, -1
    return step, 0


@compiled
def sweep_back(plan: Array, task: Array, m: Material, n: Numbers, damping: float) -> float:
    """Write the feedback laws into `plan`; returns the largest step that they begin with [V/m].

    Args:
        plan: shape (N + 1, COLUMNS), a trajectory with its sensitivities.
        task: as for `roll_out`; its set-point may be newer than the plan.
        m: the material.
        n: the problem's numbers.
        damping: added to the curvature of every field, as a share of it.
    """
    last = plan.shape[0] - 1
    per_field, per_x = 1.0 / m.reciprocal_permittivity, 2.0 * m.domain_polarization
    p = per_field * plan[last, FIELD] + per_x * (plan[last, X] - 0.5)
    end = n.end_weight * (p - task[last - 1, NUMBERS + STAGES - 1])
    v_x, v_e = end * per_x, end * per_field
    v_xx, v_xe, v_ee = n.end_weight * per_x**2, n.end_weight * per_x * per_field, n.end_weight * per_field**2
    largest = 0.0
    for k in range(last - 1, -1, -1):
        row = plan[k]
        field, right = row[FIELD], plan[k + 1, FIELD]
        q_x = q_e = q_u = q_xx = q_xe = q_xu = q_ee = q_eu = q_uu = 0.0
        for i in range(STAGES):
            weight = n.h * _B[i]
            x = per_x * row[BY_X + i]
            e = per_x * row[BY_LEFT + i] + per_field * (1.0 - _C[i])
            u = per_x * row[BY_RIGHT + i] + per_field * _C[i]
            p = per_field * (field + _C[i] * (right - field)) + per_x * (row[STAGE + i] - 0.5)
            miss = weight * (p - task[k, NUMBERS + i])
            q_x += miss * x
            q_e += miss * e
            q_u += miss * u
            q_xx += weight * x * x
            q_xe += weight * x * e
            q_xu += weight * x * u
            q_ee += weight * e * e
            q_eu += weight * e * u
            q_uu += weight * u * u
        stiffness = n.rate_weight / n.h
        q_u += stiffness * (right - field)
        q_e -= stiffness * (right - field)
        q_uu += stiffness
        q_ee += stiffness
        q_eu -= stiffness
        # the rest of the horizon, seen through x+ and the field at the end of the interval
        b, c, g = row[BY_X + 2], row[BY_LEFT + 2], row[BY_RIGHT + 2]
        q_x += v_x * b
        q_e += v_x * c
        q_u += v_x * g + v_e
        q_xx += v_xx * b * b
        q_xe += v_xx * b * c
        q_ee += v_xx * c * c
        q_xu += (v_xx * g + v_xe) * b
        q_eu += (v_xx * g + v_xe) * c
        q_uu += (v_xx * g + 2.0 * v_xe) * g + v_ee

        low, high, by_x, by_e = _room(row, m, n, field, right)
        feed, held = _law_of_field(q_u, q_uu * (1.0 + damping), 0.0, low[0], high[0])
        if held == 0:
            k_x, k_e = -q_xu / (q_uu * (1.0 + damping)), -q_eu / (q_uu * (1.0 + damping))
        else:
            which = high[1] if held > 0 else low[1]
            k_x = by_x if which == 2 else 0.0
            k_e = 0.0 if which == 0 else 1.0 if which == 1 else by_e
        row[FEED], row[GAIN_X], row[GAIN_LEFT] = feed, k_x, k_e
        largest = max(largest, abs(feed))

        slope = q_u + q_uu * feed
        v_x, v_e = q_x + k_x * slope + q_xu * feed, q_e + k_e * slope + q_eu * feed
        v_xx = q_xx + (2.0 * q_xu + k_x * q_uu) * k_x
        v_xe = q_xe + q_xu * k_e + q_eu * k_x + k_x * q_uu * k_e
        v_ee = q_ee + (2.0 * q_eu + k_e * q_uu) * k_e

    first = plan[last]
    first[FEED] = first[GAIN_X] = first[GAIN_LEFT] = 0.0
    if math.isnan(n.initial_field):
        field = plan[0, FIELD]
        first[FEED], held = _law_of_field(v_e, v_ee, 0.0, n.lowest - field, n.highest - field)
        if held == 0 and v_ee > 0.0:
            first[GAIN_X] = -v_xe / v_ee
    return max(largest, abs(first[FEED]))


@njit(**WITHIN)
def _room(
    row: Array, m: Material, n: Numbers, field: float, right: float
) -> tuple[tuple[float, int], tuple[float, int], float, float]:
    """By how much the field at the end may fall and rise [V/m], and what stops it: 0 window, 1 slew, 2 current.

    The last two numbers say how the limit by current moves with x+ and with the field at the beginning.
    """
    low, high = n.lowest - right, n.highest - right
    by_low = by_high = 0
    if field - n.step - right > low:
        low, by_low = field - n.step - right, 1
    if field + n.step - right < high:
        high, by_high = field + n.step - right, 1
    by_x = by_e = 0.0
    if n.charge < math.inf:
        per_field, per_x = 1.0 / m.reciprocal_permittivity, 2.0 * m.domain_polarization
        gained = per_field * (right - field) + per_x * (row[STAGE + 2] - row[X])
        by_u = per_field + per_x * row[BY_RIGHT + 2]
        by_x = -per_x * (row[BY_X + 2] - 1.0) / by_u
        by_e = (per_field - per_x * row[BY_LEFT + 2]) / by_u
        if (-n.charge - gained) / by_u > low:
            low, by_low = (-n.charge - gained) / by_u, 2
        if (n.charge - gained) / by_u < high:
            high, by_high = (n.charge - gained) / by_u, 2
    return (low, by_low), (high, by_high), by_x, by_e


@compiled
def roll_out(old: Array, new: Array, task: Array, m: Material, n: Numbers, x: float, share: float) -> float:
    """Run the model forwards under the laws of `old`, into `new`; returns the cost [C^2 s/m^4], infinite on failure.

    Args:
        old: plan with feedback laws.
        new: plan that is written.
        task: barrier law and set-point at the Radau points of every interval, shape (N, NUMBERS + 3).
        m: the material.
        n: the problem's numbers.
        x: phase fraction at the beginning.
        share: of the step to take (1: all of it).
    """
    last = old.shape[0] - 1
    per_field, per_x = 1.0 / m.reciprocal_permittivity, 2.0 * m.domain_polarization
    field = n.initial_field
    if math.isnan(field):
        field = old[0, FIELD] + share * old[last, FEED] + old[last, GAIN_X] * (x - old[0, X])
        field = min(max(field, n.lowest), n.highest)
    cost = miss = 0.0
    for k in range(last):
        before, row = old[k], new[k]
        dx, de = x - before[X], field - before[FIELD]
        right = old[k + 1, FIELD] + share * before[FEED] + before[GAIN_X] * dx + before[GAIN_LEFT] * de
        lowest, highest = max(n.lowest, field - n.step), min(n.highest, field + n.step)
        right = min(max(right, lowest), highest)
        row[FIELD], row[X] = field, x
        du = right - old[k + 1, FIELD]
        for i in range(STAGES):
            row[STAGE + i] = (
                before[STAGE + i] + before[BY_X + i] * dx + before[BY_LEFT + i] * de + before[BY_RIGHT + i] * du
            )
        if not collocate(row, task[k, :NUMBERS], m, n.h, right):
            return math.inf
        if n.charge < math.inf:
            for _ in range(_CORRECTIONS):
                gained = per_field * (right - field) + per_x * (row[STAGE + 2] - x)
                if abs(gained) <= n.charge * (1.0 + 1e-9):
                    break
                beyond = gained - math.copysign(n.charge, gained)
                right -= beyond / (per_field + per_x * row[BY_RIGHT + 2])
                right = min(max(right, lowest), highest)
                if not collocate(row, task[k, :NUMBERS], m, n.h, right):
                    return math.inf
        for i in range(STAGES):
            p = per_field * (field + _C[i] * (right - field)) + per_x * (row[STAGE + i] - 0.5)
            miss = p - task[k, NUMBERS + i]
            cost += n.h * _B[i] * miss**2
        cost += n.rate_weight / n.h * (right - field) ** 2
        x, field = row[STAGE + 2], right
    new[last, FIELD], new[last, X] = field, x
    return cost + n.end_weight * miss**2


@compiled
def iterate(old: Array, new: Array, task: Array, m: Material, n: Numbers, x: float) -> float:
    """One real-time iteration from phase fraction `x`: a full step from plan `old` to plan `new`; returns the cost."""
    sweep_back(old, task, m, n, 0.0)
    return roll_out(old, new, task, m, n, x, 1.0)


@njit(**WITHIN)
def _copy(target: Array, source: Array) -> None:
    """Copy a plan; as slices this would take Numba seconds to compile."""
    for k in range(source.shape[0]):
        for column in range(source.shape[1]):
            target[k, column] = source[k, column]


@compiled
def begin(plan: Array, scratch: Array, task: Array, m: Material, n: Numbers, x: float, field: float) -> float:
    """A first plan under a constant field [V/m], as far as the limits let it; returns the cost."""
    for k in range(plan.shape[0]):
        for column in range(plan.shape[1]):
            scratch[k, column] = 0.0
        scratch[k, FIELD], scratch[k, X] = field, x
        for i in range(STAGES):
            scratch[k, STAGE + i] = x
    return roll_out(scratch, plan, task, m, n, x, 0.0)


@compiled
def solve(
    plan: Array, trial: Array, task: Array, m: Material, n: Numbers, x: float, cost: float, tolerance: float, most: int
) -> tuple[float, int, bool]:
    """Iterate until no field would move by more than `tolerance` [V/m], with a line search; the plan is changed.

    Args:
        plan: where to begin.
        trial: scratch of the same shape.
        task, m, n, x: as for `roll_out`.
        cost: of the plan, if it is a trajectory of this task from x; NaN otherwise.
        tolerance: [V/m].
        most: iterations.

    Returns:
        the cost [C^2 s/m^4], the number of iterations, and whether it has converged.
    """
    if math.isnan(cost):
        cost = roll_out(plan, trial, task, m, n, x, 0.0)
        _copy(plan, trial)
    damping = 0.0
    for iteration in range(most):
        if sweep_back(plan, task, m, n, damping) <= tolerance:
            return cost, iteration, True
        share, found = 1.0, math.inf
        for _ in range(_SHORTENINGS):
            found = roll_out(plan, trial, task, m, n, x, share)
            if found < cost:
                break
            share *= 0.4
        if found < cost:
            damping = 0.0 if damping < 1e-3 else 0.1 * damping
            _copy(plan, trial)
            if cost - found <= _NO_GAIN * cost:
                return found, iteration + 1, True
            cost = found
        elif damping > 1e3:
            return cost, iteration + 1, False
        else:
            damping = max(1e-2, 10.0 * damping)
    return cost, most, False
