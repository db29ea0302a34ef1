"""Many domains under one field: the compiled loops of the quadrature and of the lattice.

Domain (i, j) switches up where the field reaches a = E_c - E_e and down where it falls to b = -E_c - E_e. All domains
of row i find their rates in one slice of a table over a and one of a table over b:

    up:   forward[rows - 1 - i + j],    down: backward[i + j],    j = 0 ... columns - 1.

On a lattice (same spacing for E_c and E_e) many domains share an entry (methods.md 1.3), and few of them move: those
at the two fronts of the return-point memory. Both make it fast. A quadrature has nothing to share; it is one row with
an entry for every domain, in no order, and all of it is stepped.

Each domain obeys x' = p (1 - x) - q x (3.8), linear in x for a given field. Two integrators:

* midpoint: rates frozen at mid-step; order 2, exact in holds, one division per domain. In a slow ramp a domain with a
  low barrier follows its equilibrium p/(p + q), which mid-step rates know half a step late: order 1 there.
* collocation: with s = p + q and the inner clock sigma = int s dt, x' = s (xe - x) has a closed solution for xe
  quadratic in sigma; xe and s are taken at both ends and the middle of the step (exponential collocation: Hochbruck and
  Ostermann, Acta Numerica 2010, section 2). Order 4, and ends on the equilibrium however slow the ramp. Magnus-4 is as
  good in fast ramps, but its commutator grows with the step times the rate and wrecks slow ones: errors above 1 in x+.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pzt_ros.physics.compiling import OUTER, WITHIN, copy_onto
from pzt_ros.physics.kinetics import exponential, switching_rate
from pzt_ros.physics.polycrystal_steps import collocate, fall, midpoint, rise
from pzt_ros.physics.signals import Array

MIDPOINT, COLLOCATION = 0, 1
TIME, VOLTAGE, SLOPE, HEAD = 0, 1, 2, 3
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], every x."""

_MAX_SUBSTEPS = 1e5
_LONGEST_STEP = 0.5  # in units of d: beyond, the order of a method says nothing
_NEVER = 1e-100
"""[1/s]; added to every rate. It keeps p/(p + q) defined for a frozen domain, and all that follows from rates away from
numbers below 1e-308, for which many processors take a hundred times as long."""

_GONE = -200.0  # exp of it is as good as 0, and its products are no such small numbers either
_STILL = 1e-12
"""Of x [-]. Domains of a lattice that move by less in a step are left where they are: anything moves only near the two
fronts, where the field switches up and down just now, one domain in fifty."""
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]; a hundred times what breaks a ceramic


class Elements(NamedTuple):
    """The domains and what they have in common; arrays as the module's head says.

    Attributes:
        forward, backward: a/d and b/d [-], shape (rows + columns - 1,).
        row_weight, column_weight: shapes (rows,), (columns,); the weight of domain (i, j) is their product. Where that
            will not do, column_weight has the shape (rows * columns,), a row after the other.
        width: thermal width d [V/m].
        attempt_rate: 1/tau, times the prefactor of (3.9) if that is wanted [1/s].
        susceptibility: 1/E_1 [C/(V m)].
        domain_polarization: P_T [C/m^2].
        bias: polarization that the interaction fields alone would make [C/m^2].
        layer_thickness: [m].
        method: MIDPOINT or COLLOCATION.
        field_step: the substep for slow ramps in units of d [-], see `field_step`.
    """

    forward: Array
    backward: Array
    row_weight: Array
    column_weight: Array
    width: float
    attempt_rate: float
    susceptibility: float
    domain_polarization: float
    bias: float
    layer_thickness: float
    method: int
    field_step: float


def field_step(method: int, accuracy: float) -> float:
    """The substep of a slow ramp [-, in units of d] that keeps the error of x+ below about `accuracy`."""
    if method == MIDPOINT:
        return 0.01 * math.sqrt(accuracy / 1e-6)
    return 0.035 * math.sqrt(math.sqrt(accuracy / 1e-6))


@njit(**WITHIN, error_model="numpy")
def _substeps(el, climb, duration):  # type: ignore[no-untyped-def]
    """How many substeps a ramp over `climb` [in units of d] needs."""
    step = el.field_step
    if el.method == COLLOCATION:
        # fast ramps leave low barriers no time to follow their equilibrium, and the error falls as 1/rate
        step *= math.sqrt(math.sqrt(1.0 + 1e3 * abs(climb) / (duration * el.attempt_rate)))
    needed = math.ceil(abs(climb) / min(step, _LONGEST_STEP))
    return int(min(max(needed, 1.0), _MAX_SUBSTEPS))


@njit(**WITHIN, error_model="numpy", fastmath=True)
def _fill_rates(rates, el, thresholds, sign, u):  # type: ignore[no-untyped-def]
    """Rates [1/s] at the field u [in units of d] of domains that switch beyond thresholds, up (sign 1) or down (-1)."""
    for k in range(rates.size):
        rates[k] = el.attempt_rate * switching_rate(sign * (u - thresholds[k])) + _NEVER


@njit(**WITHIN, error_model="numpy", fastmath=True)
def _fill_decay(decay, h, first, middle, last):  # type: ignore[no-untyped-def]
    """exp(- integral of a rate over the step) by Simpson's rule."""
    for k in range(decay.size):
        decay[k] = exponential(max(-h / 6.0 * (first[k] + 4.0 * middle[k] + last[k]), _GONE))


@njit(**WITHIN, error_model="numpy")
def _shape(el):  # type: ignore[no-untyped-def]
    """Rows, columns, and how far the weights of a row are behind those of the row before."""
    rows = el.row_weight.size
    columns = el.forward.size - rows + 1
    return rows, columns, columns if el.column_weight.size > columns else 0


@njit(**WITHIN, error_model="numpy")
def total_weight(el):  # type: ignore[no-untyped-def]
    """Sum of all weights [-]."""
    rows, columns, stride = _shape(el)
    if stride == 0:
        return el.row_weight.sum() * el.column_weight.sum()
    total = 0.0
    for i in range(rows):
        total += el.row_weight[i] * el.column_weight[i * stride : i * stride + columns].sum()
    return total


@njit(**WITHIN, error_model="numpy")
def _moves(el, threshold, sign, u, h):  # type: ignore[no-untyped-def]
    return h * el.attempt_rate * switching_rate(sign * (u - threshold)) > _STILL


@njit(**WITHIN, error_model="numpy")
def _first_up(el, u, h):  # type: ignore[no-untyped-def]
    """From which entry of the table on domains move up in a step of h s at the field u [in units of d]."""
    low, high = 0, el.forward.size
    while low < high:
        middle = (low + high) // 2
        if _moves(el, el.forward[middle], 1.0, u, h):
            high = middle
        else:
            low = middle + 1
    return low


@njit(**WITHIN, error_model="numpy")
def _after_down(el, u, h):  # type: ignore[no-untyped-def]
    """Before which entry they move down."""
    low, high = 0, el.backward.size
    while low < high:
        middle = (low + high) // 2
        if _moves(el, el.backward[middle], -1.0, u, h):
            low = middle + 1
        else:
            high = middle
    return low


@njit(**WITHIN, error_model="numpy")
def _find_fronts(fronts, x, el, h, lowest, highest):  # type: ignore[no-untyped-def]
    """Where domains move in a step: `fronts` begins with (row, empty, end, begin, full) for every row in which some do.

    Up go the columns from `begin` on, until they are full, down those before `end`, until they are empty; both, where
    these overlap. What lies between is held by its barrier. Along a row of a lattice x never falls: a higher bias has
    always pushed up more. The one row of a quadrature is in no order, and all of it moves.

    Returns:
        the number of these rows, and the entries of the tables that they need: from and to, up and down.
    """
    rows, columns, _ = _shape(el)
    if rows == 1:
        fronts[0, 0], fronts[0, 1], fronts[0, 2], fronts[0, 3], fronts[0, 4] = 0, 0, columns, 0, columns
        return 1, 0, columns, 0, columns
    up, down = _first_up(el, highest, h), _after_down(el, lowest, h)
    count, up_from, up_to, down_from, down_to = 0, up, up, down, down
    for i in range(rows):
        first, m = i * columns, rows - 1 - i
        begin = min(max(up - m, 0), columns)
        end = min(max(down - i, 0), columns)
        empty, full = min(begin, end), max(begin, end)
        while empty > 0 and x[first + empty - 1] > _STILL:
            empty -= 1
        while full < columns and x[first + full] < 1.0 - _STILL:
            full += 1
        if empty < end or begin < full:
            fronts[count, 0], fronts[count, 1], fronts[count, 2], fronts[count, 3] = i, empty, end, begin
            fronts[count, 4] = full
            count += 1
            up_from, up_to = min(up_from, m + begin), max(up_to, m + full)
            down_from, down_to = min(down_from, i + empty), max(down_to, i + end)
    return count, up_from, up_to, down_from, down_to


@njit(**WITHIN, error_model="numpy")
def _move(x, el, fronts, count, h, collocation, up, down):  # type: ignore[no-untyped-def]
    """One step of the domains at `count` fronts, in place."""
    rows, columns, _ = _shape(el)
    up_decay, down_decay = up[3], down[3]
    for n in range(count):
        i, empty, end, begin, full = fronts[n, 0], fronts[n, 1], fronts[n, 2], fronts[n, 3], fronts[n, 4]
        r = x[i * columns : (i + 1) * columns]
        m = rows - 1 - i
        fallen, risen = min(begin, end), max(begin, end)
        if empty < fallen:
            fall(r[empty:fallen], down_decay[i + empty : i + fallen])
        if begin < end:
            a, b, c, d = m + begin, m + end, i + begin, i + end
            p_decay, q_decay = up_decay[a:b], down_decay[c:d]
            if collocation:
                p0, pm, p1 = up[0][a:b], up[1][a:b], up[2][a:b]
                q0, qm, q1 = down[0][c:d], down[1][c:d], down[2][c:d]
                collocate(r[begin:end], h, p0, pm, p1, q0, qm, q1, p_decay, q_decay)
            else:
                midpoint(r[begin:end], up[1][a:b], p_decay, down[1][c:d], q_decay)
        if risen < full:
            rise(r[risen:full], up_decay[m + risen : m + full])


@njit(**WITHIN, error_model="numpy", fastmath=True)
def _row_sum(x, el, i):  # type: ignore[no-untyped-def]
    """Sum of weight times x along a row [-]."""
    _, columns, stride = _shape(el)
    r = x[i * columns : (i + 1) * columns]
    weight = el.column_weight[i * stride : i * stride + columns]
    total = 0.0
    for j in range(columns):
        total += r[j] * weight[j]
    return total


@njit(**WITHIN)
def _add_rows(sums, x, el):  # type: ignore[no-untyped-def]
    """Sum up every row; what a row adds to the whole depends on its domains only, however they came there."""
    for i in range(sums.size):
        sums[i] = _row_sum(x, el, i)


@njit(**WITHIN)
def _weighted_sum(sums, el):  # type: ignore[no-untyped-def]
    """Sum of weight times x over all domains [-], from those of the rows."""
    total = 0.0
    for i in range(sums.size):
        total += sums[i] * el.row_weight[i]
    return total


@njit(**WITHIN, error_model="numpy")
def _polarization(switched, weights, field, el):  # type: ignore[no-untyped-def]
    """P [C/m^2] (3.16, 3.20) from the weighted sum of x, the sum of weights and the field [V/m]."""
    return weights * field * el.susceptibility + el.bias + (2.0 * switched - weights) * el.domain_polarization


@njit(**WITHIN, error_model="numpy")
def advance(x, sums, el, work, start, end, duration):  # type: ignore[no-untyped-def]
    """Take all x and the sums of their rows, in place, through a linear ramp from start to end [V/m] in duration [s].

    Returns the weighted sum of x. `work` is as `_work` makes it, and says afterwards which rows have moved.
    """
    up, down, fronts, moved = work
    for i in range(moved.size):
        moved[i] = False
    if duration == 0.0:
        return _weighted_sum(sums, el)
    u0 = start / el.width
    climb = (end - start) / el.width
    count = _substeps(el, climb, duration)
    h = duration / count
    collocation = el.method == COLLOCATION and climb != 0.0
    first, last = (0, 2) if collocation else (1, 1)  # at the start, in the middle, at the end of a substep
    for k in range(count):
        one, other = u0 + climb * ((k + 0.5 * first) / count), u0 + climb * ((k + 0.5 * last) / count)
        moving, a, b, c, d = _find_fronts(fronts, x, el, h, min(one, other), max(one, other))
        for node in range(first, last + 1):
            u = u0 + climb * ((k + 0.5 * node) / count)
            _fill_rates(up[node][a:b], el, el.forward[a:b], 1.0, u)
            _fill_rates(down[node][c:d], el, el.backward[c:d], -1.0, u)
        _fill_decay(up[3][a:b], h, up[first][a:b], up[1][a:b], up[last][a:b])
        _fill_decay(down[3][c:d], h, down[first][c:d], down[1][c:d], down[last][c:d])
        _move(x, el, fronts, moving, h, collocation, up, down)
        for n in range(moving):
            moved[fronts[n, 0]] = True
    for i in range(sums.size):
        if moved[i]:
            sums[i] = _row_sum(x, el, i)
    return _weighted_sum(sums, el)


@njit(**WITHIN, error_model="numpy")
def _work(el):  # type: ignore[no-untyped-def]
    """Tables of rates up and down (at start, middle and end of a step, and what they leave), fronts, rows that moved.

    Shapes: (4, rows + columns - 1) twice, (rows, 5), (rows,).
    """
    rows, size = el.row_weight.size, el.forward.size
    return np.zeros((4, size)), np.zeros((4, size)), np.zeros((rows, 5), np.int64), np.zeros(rows, np.bool_)


@njit(**OUTER, error_model="numpy", nogil=True)
def run(state, el, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    work = _work(el)
    x = state[HEAD:]
    weights, sums = total_weight(el), np.zeros(el.row_weight.size)
    _add_rows(sums, x, el)
    for k in range(time.size):
        duration = time[k] - state[TIME]
        field = voltage[k] / el.layer_thickness
        if not (duration >= 0.0 and math.isfinite(time[k]) and abs(field) <= _NO_SUCH_FIELD):
            return k
        switched = advance(x, sums, el, work, state[VOLTAGE] / el.layer_thickness, field, duration)
        state[TIME], state[VOLTAGE] = time[k], voltage[k]
        phase_fraction[k] = switched / weights
        polarization[k] = _polarization(switched, weights, field, el)
    return -1


@njit(**WITHIN)
def _copy_moved(x, sums, source_x, source_sums, moved):  # type: ignore[no-untyped-def]
    """Copy the rows that have moved, and their sums."""
    columns = x.size // sums.size
    for i in range(sums.size):
        if moved[i]:
            sums[i] = source_sums[i]
            copy_onto(x[i * columns : (i + 1) * columns], source_x[i * columns : (i + 1) * columns])


@njit(**OUTER, error_model="numpy", nogil=True)
def run_inverse(state, el, time, target, voltage, phase_fraction, limit, tolerance):  # type: ignore[no-untyped-def]
    """Find the voltage at the end of each sample that gives the target polarization [C/m^2]; otherwise as `run`.

    P rises with the voltage, at least as steeply as without switching, and a root lies within +-limit [V] or beyond:
    then the limit is the answer. The first trial continues with the last sample's slope, then a Newton step, then
    secants; bisection where they leave the bracket or do not halve it in three.
    """
    work = _work(el)
    x = state[HEAD:]
    weights, sums = total_weight(el), np.zeros(el.row_weight.size)
    _add_rows(sums, x, el)
    trial_x, trial_sums = x.copy(), sums.copy()
    least_slope = weights * el.susceptibility / el.layer_thickness
    for k in range(time.size):
        duration = time[k] - state[TIME]
        if not (duration >= 0.0 and math.isfinite(time[k])):
            return k
        start = state[VOLTAGE] / el.layer_thickness
        known = math.isfinite(target[k])
        way = target[k] - _polarization(_weighted_sum(sums, el), weights, start, el)
        v = state[VOLTAGE]
        if known:
            v = min(max(v + way / state[SLOPE], -limit), limit)
        low, high, checked = -limit, limit, 4.0 * limit
        slope, v_old, miss_old = least_slope, 0.0, 0.0
        for trial in range(_MAX_TRIALS):
            if trial > 0:
                _copy_moved(trial_x, trial_sums, x, sums, work[3])
            field = v / el.layer_thickness
            switched = advance(trial_x, trial_sums, el, work, start, field, duration)
            miss = _polarization(switched, weights, field, el) - target[k]
            if not known or abs(miss) <= tolerance:
                break
            if miss < 0.0:
                low = v
            else:
                high = v
            if high - low <= 1e-15 * limit:
                break  # also the way out at a limit: the wanted P is out of reach
            if trial > 0:
                slope = max((miss - miss_old) / (v - v_old), least_slope)
            v_old, miss_old = v, miss
            v = min(max(v - miss / slope, low), high)
            stuck = v == v_old or -limit < low == v or v == high < limit
            if trial % 3 == 2:
                stuck = stuck or high - low > 0.5 * checked
                checked = high - low
            if stuck:
                v = 0.5 * (low + high)
        climb = v - state[VOLTAGE]
        if known and abs(climb) > 1e-9 * limit:
            state[SLOPE] = max((way + miss) / climb, least_slope)
        _copy_moved(x, sums, trial_x, trial_sums, work[3])
        state[TIME], state[VOLTAGE] = time[k], v
        voltage[k] = v
        phase_fraction[k] = switched / weights
    return -1
