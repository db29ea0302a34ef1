"""Relays with thermal kinetics on a triangle of thresholds: the compiled loops of the identified lattice.

Thresholds lie on n equally spaced lines; relay (i, j) with j < i and i - j odd switches up at line i (field a) and down
at line j (field b). These are the midpoints of a lattice of coercive fields (a - b)/2 and interaction fields -(a + b)/2
of the same spacing (methods.md 1.3). Row i holds the relays j = odd, odd + 2, ... in a row from place i*i//4 on.

Each relay obeys x' = p (1 - x) - q x (3.8). Over a linear piece of field the expected attempts of a line are known
exactly, int p dt = (Phi(z1) - Phi(z0)) h d/(tau dE), Phi(z) = int dz/erfcx(z) = -sqrt(pi)/2 ln(erfc(z)/2). Hence

* where only one of both rates acts, x = (1 - (1 - x) exp(-int p dt)) exp(-int q dt) is the solution, for any step;
* where both may act, with low barriers near the field, the equilibrium xe = p/(p + q) is taken as quadratic in the
  inner clock int (p + q) dt, through its values at both ends and its mean int p dt/int (p + q) dt: exact for short
  times, and on the equilibrium after long ones (as the collocation of polycrystal_kernel, but with the true mean).

Only the relays near the field have anything to do. In a row where nothing switches down and which has seen _SURE
attempts up since something did, every x is 1; in a column likewise 0; and a relay that both are far from remembers.

Everything is linear in the x at the start: x(t) = forced(t) + decay(t) x(0), which is how an unknown start is found.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import special

from pzt_ros.physics.identified_hats import accumulate
from pzt_ros.physics.kinetics import exponential, switching_rate
from pzt_ros.physics.signals import Array

TIME, VOLTAGE, SLOPE, HEAD = 0, 1, 2, 3
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], every x."""

_FIRST, _LAST, _PER_UNIT = -11.0, 13.0, 32
_LEVEL = 1e-4  # climb in units of d below which the rate at the middle is exact enough
_STEEP = 12.0  # from here on 1/erfcx is sqrt(pi) (z + 1/(2z)) to 1e-5
_ROOT_PI = math.sqrt(math.pi)
_FEW = 1e-5  # attempts that do not count where the other rate acts
_NEVER = 1e-290
_NOTHING, _FARTHEST = 1e-13, 10.0  # attempts that do not count anywhere; nothing is felt from there
_FORGOTTEN = 1e-30  # numbers that underflow are slow
_SURE = 70.0  # after as many attempts exp(-attempts) is below _FORGOTTEN
_MAX_SUBSTEPS = 1e5
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]

KNOWN, MET_UP, MET_DOWN, UP, DOWN_EVEN, DOWN_ODD, MANY_UP, MANY_DOWN, P0, Q0, P1, Q1, TABLES = range(13)
"""Tables over the lines: attempts since the other way was possible, exp(-attempts) and attempts in a step, rates at its
start and end. KNOWN: the field where this was so: every x is 1 in the rows before .., 0 in the columns from .. on.
"""


class Relays(NamedTuple):
    """The relays and what they have in common.

    Attributes:
        lines: thresholds over d, ascending, equally spaced [-, shape (n,)].
        weight: polarization of each relay [C/m^2, shape (n*n//4,)].
        width: thermal width d [V/m].
        attempt_rate: 1/tau [1/s].
        susceptibility: of what does not switch [C/(V m)].
        offset: frozen polarization [C/m^2].
        layer_thickness: [m].
        field_step: longest substep in units of d [-].
        attempts: Phi and its derivatives, see `attempts_table`.
    """

    lines: Array
    weight: Array
    width: float
    attempt_rate: float
    susceptibility: float
    offset: float
    layer_thickness: float
    field_step: float
    attempts: Array


def attempts_table(spacing: float) -> Array:
    """Phi, h Phi' and h^2 Phi'' for z = -11, -11 + h, ... 13, where h divides the spacing of the lines [d].

    All lines then lie at the same place between two nodes, m nodes apart: shape (2, 3, m + 1, k), with falling z and
    with rising z, by place and then by spacing; place m is place 0 of the next spacing.
    """
    places = math.ceil(spacing * _PER_UNIT)
    count = math.ceil((_LAST - _FIRST) / spacing) + 1
    z = _FIRST + spacing * (np.arange(count) + np.arange(places + 1)[:, None] / places)
    rate, h = 1 / special.erfcx(z), spacing / places
    phi = -0.5 * _ROOT_PI * special.log_ndtr(-math.sqrt(2.0) * z)
    rising = np.stack([phi, h * rate, h * h * rate * (2 / _ROOT_PI * rate - 2 * z)])
    return np.stack([rising[..., ::-1], rising])


@njit(cache=True, inline="always", error_model="numpy")
def _place(relays, u, sign):  # type: ignore[no-untyped-def]
    """Where z = sign (u - line) lies: which table, column of line 0, place, and weights of the nodes there and next."""
    spacing = relays.lines[1] - relays.lines[0]
    _, _, places, count = relays.attempts.shape
    far = (sign * (u - relays.lines[0]) - _FIRST) / spacing
    column = math.floor(far)
    along = (far - column) * (places - 1)
    place = min(int(along), places - 2)
    t = along - place
    rest = 1.0 - t
    value, slope, next_slope = rest * rest * (1.0 + 2.0 * t), rest * rest * t, -rest * t * t
    up = sign > 0.0
    return 0 if up else 1, count - 1 - column if up else column, place, value, 1.0 - value, slope, next_slope


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_attempts(many, relays, u0, u1, sign, clock, first, end):  # type: ignore[no-untyped-def]
    """Attempts of lines first ... end - 1 while the field goes from u0 to u1 in `clock` relaxation times."""
    climb, lines, table = sign * (u1 - u0), relays.lines, relays.attempts
    middle = 0.5 * (u0 + u1)
    if abs(climb) < _LEVEL:
        for k in range(first, end):
            many[k] = clock * switching_rate(sign * (middle - lines[k]))
        return
    steep = (min(sign * u0, sign * u1) - _STEEP - sign * lines[0]) / (
        lines[1] - lines[0]
    )  # that many lines from line 0
    begin, stop = first, end
    if sign > 0.0:
        begin = int(min(max(math.ceil(steep), first), end))
    else:
        stop = int(min(max(math.floor(-steep) + 1, first), end))
    for k in range(first, begin):
        z = sign * (middle - lines[k])
        many[k] = clock * _ROOT_PI * (z + 0.5 / z)
    for k in range(stop, end):
        z = sign * (middle - lines[k])
        many[k] = clock * _ROOT_PI * (z + 0.5 / z)
    way, column0, p0, f0, g0, s0, n0 = _place(relays, u0, sign)
    _, column1, p1, f1, g1, s1, n1 = _place(relays, u1, sign)
    scale = clock / climb
    for k in range(begin, stop):
        i0, i1 = np.uint64(column0 + k), np.uint64(column1 + k)  # unsigned: a sign to look at would prevent SIMD
        before = f0 * table[way, 0, p0, i0] + g0 * table[way, 0, p0 + 1, i0]
        before += s0 * table[way, 1, p0, i0] + n0 * table[way, 1, p0 + 1, i0]
        after = f1 * table[way, 0, p1, i1] + g1 * table[way, 0, p1 + 1, i1]
        after += s1 * table[way, 1, p1, i1] + n1 * table[way, 1, p1 + 1, i1]
        many[k] = max((after - before) * scale, 0.0)


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_rates(rates, relays, u, sign, first, last):  # type: ignore[no-untyped-def]
    """1/erfcx(sign (u - line)) for lines first ... last."""
    table = relays.attempts
    way, column, p, f, g, s, n = _place(relays, u, sign)
    per_h = (table.shape[2] - 1) / (relays.lines[1] - relays.lines[0])
    for k in range(first, last + 1):
        i = np.uint64(column + k)
        rate = f * table[way, 1, p, i] + g * table[way, 1, p + 1, i]
        rates[k] = per_h * (rate + s * table[way, 2, p, i] + n * table[way, 2, p + 1, i])


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_tables(work, relays, u0, u1, clock, up_from, up_end, down_from, down_end, first, last):  # type: ignore[no-untyped-def]
    """All tables of a substep for the lines that switch; rates at its ends only for lines first ... last."""
    _fill_attempts(work[MANY_UP], relays, u0, u1, 1.0, clock, up_from, up_end)
    _fill_attempts(work[MANY_DOWN], relays, u0, u1, -1.0, clock, down_from, down_end)
    for k in range(up_from, up_end):
        work[UP, k] = exponential(-work[MANY_UP, k])
        work[MET_UP, k] = work[MET_UP, k] + work[MANY_UP, k] if k < down_from else 0.0
    for k in range((down_from + 1) // 2, (down_end + 1) // 2):
        work[DOWN_EVEN, k] = exponential(-work[MANY_DOWN, 2 * k])
    for k in range(down_from // 2, down_end // 2):
        work[DOWN_ODD, k] = exponential(-work[MANY_DOWN, 2 * k + 1])
    for k in range(down_from, down_end):
        work[MET_DOWN, k] = work[MET_DOWN, k] + work[MANY_DOWN, k] if k >= up_end else 0.0
    _fill_rates(work[P0], relays, u0, 1.0, first, last)
    _fill_rates(work[P1], relays, u1, 1.0, first, last)
    _fill_rates(work[Q0], relays, u0, -1.0, first, last)
    _fill_rates(work[Q1], relays, u1, -1.0, first, last)


@njit(cache=True, inline="always", error_model="numpy")
def _balanced(x, decay, work, i, j):  # type: ignore[no-untyped-def]
    """x of relay (i, j) after a substep in which both rates may act."""
    p0, q0, p1, q1 = work[P0, i], work[Q0, j], work[P1, i], work[Q1, j]
    clock = work[MANY_UP, i] + work[MANY_DOWN, j] + 1e-300
    x0 = p0 / (p0 + q0 + _NEVER)
    x1 = p1 / (p1 + q1 + _NEVER)
    mean = work[MANY_UP, i] / clock
    curvature = 3.0 * (x0 + x1) - 6.0 * mean
    slope = x1 - x0 - curvature
    if clock < 0.05:  # phi_2 = (exp(-clock) - 1 + clock)/clock^2, where this cancels
        phi2 = 1 / 2 - clock * (1 / 6 - clock * (1 / 24 - clock * (1 / 120 - clock * (1 / 720 - clock / 5040))))
    else:
        phi2 = (decay - 1.0 + clock) / (clock * clock)
    phi1 = 1.0 - clock * phi2
    moved = x1 + decay * (x - x0) - slope * phi1 - 2.0 * curvature * phi2
    return min(max(moved, 0.0), 1.0)


@njit(cache=True, error_model="numpy", fastmath=True)
def _move(x, weight, work, up_from, up_end, down_from, down_end, first, last):  # type: ignore[no-untyped-def]
    """One substep of every relay that has anything to do, in place; returns by how much sum(weight x) rose.

    Places are unsigned and nothing is sliced: with short rows that is twice as fast.
    """
    rise = 0.0
    for i in range(max(up_from, 1), work.shape[1]):
        odd = (i + 1) % 2
        count = (min(i, down_end) - odd + 1) // 2
        near = min((max(down_from, odd) - odd + 1) // 2, count)  # relays before this one do not switch down
        begin, fall = i * i // 4, DOWN_ODD if odd else DOWN_EVEN
        if i >= up_end:
            for k in range(near, count):
                r = np.uint64(begin + k)
                moved = x[r] * work[fall, np.uint64(k)]
                rise += weight[r] * (moved - x[r])
                x[r] = moved
            continue
        stay = work[UP, i]
        far = min((max(first, odd) - odd + 1) // 2, count) if first < i <= last else count
        for k in range(near):
            r = np.uint64(begin + k)
            moved = 1.0 - (1.0 - x[r]) * stay
            rise += weight[r] * (moved - x[r])
            x[r] = moved
        for k in range(near, far):
            r = np.uint64(begin + k)
            moved = (1.0 - (1.0 - x[r]) * stay) * work[fall, np.uint64(k)]
            rise += weight[r] * (moved - x[r])
            x[r] = moved
        for k in range(far, count):  # both rates act, and both are felt
            r = np.uint64(begin + k)
            moved = _balanced(x[r], stay * work[fall, np.uint64(k)], work, i, 2 * k + odd)
            rise += weight[r] * (moved - x[r])
            x[r] = moved
    return rise


@njit(cache=True, error_model="numpy", fastmath=True)
def _forget(left, work, up_from, up_end, down_from, down_end):  # type: ignore[no-untyped-def]
    """What is left of every x at the start after the same substep, in place."""
    for i in range(max(up_from, 1), work.shape[1]):
        odd = (i + 1) % 2
        count = (min(i, down_end) - odd + 1) // 2
        near = min((max(down_from, odd) - odd + 1) // 2, count)
        share = left[i * i // 4 : i * i // 4 + count]
        fall = work[DOWN_ODD, :count] if odd else work[DOWN_EVEN, :count]
        stay = work[UP, i] if i < up_end else 1.0
        for k in range(count):
            still = share[k] * (stay * fall[k] if k >= near else stay)
            share[k] = still if still > _FORGOTTEN else 0.0


@njit(cache=True, error_model="numpy")
def _lines_near(lines, lowest, highest):  # type: ignore[no-untyped-def]
    """The first line from `lowest` on, and the last up to `highest`."""
    spacing = lines[1] - lines[0]
    first = math.ceil(max((lowest - lines[0]) / spacing, 0.0))
    last = math.floor(min((highest - lines[0]) / spacing, lines.size - 1.0))
    return int(min(first, lines.size)), int(max(last, -1))


@njit(cache=True, error_model="numpy")
def _reach(clock, attempts):  # type: ignore[no-untyped-def]
    """So far from a line [d] a rate makes no more than `attempts` in `clock` relaxation times."""
    return min(math.sqrt(max(math.log(0.5 * clock / attempts), 1.0)), _FARTHEST)


@njit(cache=True, error_model="numpy")
def advance(x, left, relays, work, start, end, duration):  # type: ignore[no-untyped-def]
    """Take all x, in place, through a linear ramp from start to end [V/m] in duration [s].

    Args:
        x: of every relay [-].
        left: what is left of each x(0) [-, as x], or an empty array where nobody wants to know.
        work: shape (TABLES, n); whoever changes x himself says so by a KNOWN field of NaN.

    Returns:
        By how much the weighted sum of x rose [C/m^2].
    """
    if duration == 0.0:
        return 0.0
    n = relays.lines.size
    u0 = start / relays.width
    climb = (end - start) / relays.width
    count = int(min(max(math.ceil(abs(climb) / relays.field_step), 1.0), _MAX_SUBSTEPS))
    clock = duration * relays.attempt_rate / count
    felt, both_felt = _reach(clock, _NOTHING), _reach(clock, _FEW)
    known = work[KNOWN]
    if known[0] != u0:
        known[0], known[1], known[2] = u0, 0.0, n
        work[MET_UP], work[MET_DOWN] = 0.0, 0.0
    ones, zeros = int(known[1]), int(known[2])
    before, rise = u0, 0.0
    for k in range(count):
        after = u0 + climb * (k + 1) / count if k < count - 1 else end / relays.width
        lowest, highest = min(before, after), max(before, after)
        down_from, up_last = _lines_near(relays.lines, lowest - felt, highest + felt)
        up_end = up_last + 1
        ones, zeros = min(ones, down_from), max(zeros, up_end)
        first, last = _lines_near(relays.lines, lowest - both_felt, highest + both_felt)
        _fill_tables(work, relays, before, after, clock, ones, up_end, down_from, zeros, first, last)
        rise += _move(x, relays.weight, work, ones, up_end, down_from, zeros, first, last)
        if left.size > 0:
            _forget(left, work, ones, up_end, down_from, zeros)
        while ones < min(down_from, up_end) and work[MET_UP, ones] >= _SURE:
            ones += 1
        while zeros > max(down_from, up_end) and work[MET_DOWN, zeros - 1] >= _SURE:
            zeros -= 1
        before = after
    known[0], known[1], known[2] = before, ones, zeros
    return rise


@njit(cache=True, error_model="numpy", fastmath=True)
def weighted_sum(x, weight):  # type: ignore[no-untyped-def]
    """Sum of weight times x [C/m^2]."""
    total = 0.0
    for k in range(x.size):
        total += x[k] * weight[k]
    return total


@njit(cache=True, error_model="numpy")
def _polarization(switched, weights, field, relays):  # type: ignore[no-untyped-def]
    return 2.0 * switched - weights + relays.susceptibility * field + relays.offset


@njit(cache=True, error_model="numpy")
def _is_usable(time, voltage, state, relays):  # type: ignore[no-untyped-def]
    field = voltage / relays.layer_thickness
    return time - state[TIME] >= 0.0 and math.isfinite(time) and abs(field) <= _NO_SUCH_FIELD


@njit(cache=True, error_model="numpy")
def _sample(state, left, relays, work, time, voltage):  # type: ignore[no-untyped-def]
    """Move the state to the next sample; returns by how much the weighted sum of x rose [C/m^2]."""
    thickness = relays.layer_thickness
    duration = time - state[TIME]
    rise = advance(state[HEAD:], left, relays, work, state[VOLTAGE] / thickness, voltage / thickness, duration)
    state[TIME], state[VOLTAGE] = time, voltage
    return rise


@njit(cache=True, error_model="numpy", nogil=True)
def run(state, relays, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    work = np.full((TABLES, relays.lines.size), np.nan)
    weights, switched = relays.weight.sum(), weighted_sum(state[HEAD:], relays.weight)
    for k in range(time.size):
        if not _is_usable(time[k], voltage[k], state, relays):
            return k
        switched += _sample(state, np.empty(0), relays, work, time[k], voltage[k])
        phase_fraction[k] = min(max(switched / weights, 0.0), 1.0)
        polarization[k] = _polarization(switched, weights, voltage[k] / relays.layer_thickness, relays)
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def settle(state, left, relays, duration):  # type: ignore[no-untyped-def]
    """Rest at the voltage of the state; x and what is left of x(0), where that is followed, move in place."""
    work = np.full((TABLES, relays.lines.size), np.nan)
    field = state[VOLTAGE] / relays.layer_thickness
    advance(state[HEAD:], left, relays, work, field, field, duration)


@njit(cache=True, error_model="numpy", nogil=True)
def run_columns(state, left, relays, time, voltage, polarization, columns, hats, hats_at, starts, starts_at):  # type: ignore[no-untyped-def]
    """As `run`, and what polarization is made of.

    Args:
        state, relays, time, voltage, polarization: as in `run`.
        left: what is left of x(0), moves in place; empty: not followed.
        columns: some are filled [shape (n, p)].
        hats, hats_at: from that column on: sum over relays of hat times x.
        starts, starts_at: likewise: sum of hat times weight times what is left of x(0), if that is followed.
    """
    n = relays.lines.size
    work = np.full((TABLES, n), np.nan)
    hat_work, start_work = np.zeros((hats.size, 2, (n + 1) // 2)), np.zeros((starts.size, 2, (n + 1) // 2))
    hats_to = hats_at + hats.size * (hats.size + 1) // 2
    starts_to = starts_at + starts.size * (starts.size + 1) // 2
    weights, switched = relays.weight.sum(), weighted_sum(state[HEAD:], relays.weight)
    remains = np.empty_like(left)
    for k in range(time.size):
        if not _is_usable(time[k], voltage[k], state, relays):
            return k
        switched += _sample(state, left, relays, work, time[k], voltage[k])
        polarization[k] = _polarization(switched, weights, voltage[k] / relays.layer_thickness, relays)
        accumulate(state[HEAD:], hats, hat_work, columns[k, hats_at:hats_to])
        if left.size > 0:
            remains[:] = left * relays.weight
            accumulate(remains, starts, start_work, columns[k, starts_at:starts_to])
    return -1


@njit(cache=True, error_model="numpy")
def run_inverse(state, relays, time, target, voltage, phase_fraction, limit, tolerance):  # type: ignore[no-untyped-def]
    """Find the voltage at the end of each sample that gives the target polarization [C/m^2]; otherwise as `run`.

    P never falls with the voltage. A root is searched within +-limit [V]; where there is none, the limit is the answer.
    Secant steps from the last sample's slope, bisection where they leave the bracket or do not halve it in three.
    """
    work = np.full((TABLES, relays.lines.size), np.nan)
    weights = relays.weight.sum()
    trial = state.copy()
    for k in range(time.size):
        if not (time[k] - state[TIME] >= 0.0 and math.isfinite(time[k])):
            return k
        known = math.isfinite(target[k])
        field = state[VOLTAGE] / relays.layer_thickness
        way = target[k] - _polarization(weighted_sum(state[HEAD:], relays.weight), weights, field, relays)
        low, high, checked, slope = -limit, limit, 4.0 * limit, max(state[SLOPE], 1e-300)
        v_old, miss_old, switched = state[VOLTAGE], -way, 0.0
        v = min(max(v_old + way / slope, low), high) if known else v_old
        for count in range(_MAX_TRIALS):
            trial[:], work[KNOWN, 0] = state, np.nan
            _sample(trial, np.empty(0), relays, work, time[k], v)
            switched = weighted_sum(trial[HEAD:], relays.weight)
            miss = _polarization(switched, weights, v / relays.layer_thickness, relays) - target[k]
            if not known or abs(miss) <= tolerance:
                break
            if miss < 0.0:
                low = v
            else:
                high = v
            if high - low <= 1e-15 * limit:
                break
            if v != v_old and (count > 0 or time[k] == state[TIME]) and (miss - miss_old) / (v - v_old) > 0.0:
                slope = (miss - miss_old) / (v - v_old)
            v_old, miss_old = v, miss
            v = min(max(v - miss / slope, low), high)
            stuck = v == v_old or v <= low or v >= high
            if count % 3 == 2:
                stuck = stuck or high - low > 0.5 * checked
                checked = high - low
            if stuck:
                v = 0.5 * (low + high)
        climb = v - state[VOLTAGE]
        if known and abs(climb) > 1e-9 * limit and way + miss != 0.0:
            trial[SLOPE] = max(abs((way + miss) / climb), 1e-300)
        state[:] = trial
        voltage[k] = v
        phase_fraction[k] = switched / weights
    return -1
