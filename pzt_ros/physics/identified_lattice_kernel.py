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

import numpy as np
from numba import njit

from pzt_ros.physics.identified_hats import accumulate
from pzt_ros.physics.identified_lattice_tables import (
    DOWN_EVEN,
    DOWN_ODD,
    KNOWN,
    MANY_DOWN,
    MANY_UP,
    MET_DOWN,
    MET_UP,
    P0,
    P1,
    Q0,
    Q1,
    TABLES,
    TO_THE_BIT,
    UP,
    fill_tables,
)

TIME, VOLTAGE, SLOPE, HEAD = 0, 1, 2, 3
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], every x."""

_FEW = 1e-5  # attempts that do not count where the other rate acts
_NEVER = 1e-290
_NOTHING, _FARTHEST = 1e-13, 10.0  # attempts that do not count anywhere; nothing is felt from there
_FORGOTTEN = 1e-30  # numbers that underflow are slow
_SURE = 70.0  # after as many attempts exp(-attempts) is below _FORGOTTEN
_MAX_SUBSTEPS = 1e5
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]


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


@njit(cache=True, inline="always", error_model="numpy")
def _row(i, down_from, down_end):  # type: ignore[no-untyped-def]
    """Of row i: its first column, how many relays have something to do, how many of them do not switch down."""
    odd = (i + 1) % 2
    count = (min(i, down_end) - odd + 1) // 2
    return odd, count, min((max(down_from, odd) - odd + 1) // 2, count)


@njit(cache=True, error_model="numpy", fastmath=TO_THE_BIT)
def _move(x, work, up_from, up_end, down_from, down_end, first, last):  # type: ignore[no-untyped-def]
    """One substep of every relay that has anything to do, in place.

    Places are unsigned and nothing is sliced: with short rows that is twice as fast.
    """
    for i in range(max(up_from, 1), work.shape[1]):
        odd, count, near = _row(i, down_from, down_end)
        begin, fall = i * i // 4, DOWN_ODD if odd else DOWN_EVEN
        if i >= up_end:
            for k in range(near, count):
                r = np.uint64(begin + k)
                moved = x[r] * work[fall, np.uint64(k)]
                x[r] = moved if moved > _FORGOTTEN else 0.0
            continue
        stay = work[UP, i]
        far = min((max(first, odd) - odd + 1) // 2, count) if first < i <= last else count
        for k in range(near):
            r = np.uint64(begin + k)
            x[r] = 1.0 - (1.0 - x[r]) * stay
        for k in range(near, far):
            r = np.uint64(begin + k)
            x[r] = (1.0 - (1.0 - x[r]) * stay) * work[fall, np.uint64(k)]
        for k in range(far, count):  # both rates act, and both are felt
            r = np.uint64(begin + k)
            x[r] = _balanced(x[r], stay * work[fall, np.uint64(k)], work, i, 2 * k + odd)


@njit(cache=True, error_model="numpy", fastmath=TO_THE_BIT)
def _forget(left, work, up_from, up_end, down_from, down_end):  # type: ignore[no-untyped-def]
    """What is left of every x at the start after the same substep, in place."""
    for i in range(max(up_from, 1), work.shape[1]):
        odd, count, near = _row(i, down_from, down_end)
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
        work: shape (TABLES, n); whoever changes x himself says so by a KNOWN field of NaN. What is known saves work and
            changes nothing: the result is the same to the bit.
    """
    if duration == 0.0:
        return
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
    before = u0
    for k in range(count):
        after = u0 + climb * (k + 1) / count if k < count - 1 else end / relays.width
        lowest, highest = min(before, after), max(before, after)
        down_from, up_last = _lines_near(relays.lines, lowest - felt, highest + felt)
        up_end = up_last + 1
        ones, zeros = min(ones, down_from), max(zeros, up_end)
        first, last = _lines_near(relays.lines, lowest - both_felt, highest + both_felt)
        fill_tables(work, relays, before, after, clock, ones, up_end, down_from, zeros, first, last)
        _move(x, work, ones, up_end, down_from, zeros, first, last)
        if left.size > 0:
            _forget(left, work, ones, up_end, down_from, zeros)
        while ones < min(down_from, up_end) and work[MET_UP, ones] >= _SURE:
            ones += 1
        while zeros > max(down_from, up_end) and work[MET_DOWN, zeros - 1] >= _SURE:
            zeros -= 1
        before = after
    known[0], known[1], known[2] = before, ones, zeros


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
    """Move the state to the next sample."""
    thickness = relays.layer_thickness
    duration = time - state[TIME]
    advance(state[HEAD:], left, relays, work, state[VOLTAGE] / thickness, voltage / thickness, duration)
    state[TIME], state[VOLTAGE] = time, voltage


@njit(cache=True, error_model="numpy", nogil=True)
def run(state, relays, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    work = np.full((TABLES, relays.lines.size), np.nan)
    weights = relays.weight.sum()
    for k in range(time.size):
        if not _is_usable(time[k], voltage[k], state, relays):
            return k
        _sample(state, np.empty(0), relays, work, time[k], voltage[k])
        switched = weighted_sum(state[HEAD:], relays.weight)
        phase_fraction[k] = switched / weights
        polarization[k] = _polarization(switched, weights, voltage[k] / relays.layer_thickness, relays)
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def settle(state, left, relays, duration):  # type: ignore[no-untyped-def]
    """Rest at the voltage of the state; x and what is left of x(0), where that is followed, move in place."""
    work = np.full((TABLES, relays.lines.size), np.nan)
    field = state[VOLTAGE] / relays.layer_thickness
    advance(state[HEAD:], left, relays, work, field, field, duration)


@njit(cache=True, error_model="numpy")
def _surely(work):  # type: ignore[no-untyped-def]
    """Every x is 1 in the rows before the first number, and 0 in the columns from the second on."""
    known = work[KNOWN]
    if math.isnan(known[0]):
        return 0, work.shape[1]
    return int(known[1]), int(known[2])


@njit(cache=True, error_model="numpy")
def _sums_of_ones(hats, work):  # type: ignore[no-untyped-def]
    """Sum of every hat over the relays in the rows before each line [-, shape (n + 1, nodes)]."""
    n = hats.cell.size
    ones, sums = np.ones(n * n // 4), np.zeros((n + 1, hats.size * (hats.size + 1) // 2))
    for first_row in range(n):
        accumulate(ones, hats, work, sums[first_row], first_row)
    return sums[0] - sums


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
    weights = relays.weight.sum()
    remains, all_up = np.empty_like(left), _sums_of_ones(hats, hat_work)
    for k in range(time.size):
        if not _is_usable(time[k], voltage[k], state, relays):
            return k
        _sample(state, left, relays, work, time[k], voltage[k])
        switched = weighted_sum(state[HEAD:], relays.weight)
        polarization[k] = _polarization(switched, weights, voltage[k] / relays.layer_thickness, relays)
        ones, zeros = _surely(work)
        accumulate(state[HEAD:], hats, hat_work, columns[k, hats_at:hats_to], ones, zeros)
        columns[k, hats_at:hats_to] += all_up[ones]
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
