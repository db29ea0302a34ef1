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

_FIRST, _LAST, _PER_UNIT = -6.5, 14.0, 32
_LEVEL = 1e-4  # climb in units of d below which the rate at the middle is exact enough
_STEEP = 12.0  # from here on 1/erfcx is sqrt(pi) (z + 1/(2z)) to 1e-5
_ROOT_PI = math.sqrt(math.pi)
_FEW = 1e-5  # attempts that do not count where the other rate acts
_NEVER = 1e-290
_FORGOTTEN = 1e-30  # numbers that underflow are slow
_MAX_SUBSTEPS = 1e5
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]

AT, PHI_UP, PHI_DOWN, UP, DOWN_EVEN, DOWN_ODD, MANY_UP, MANY_DOWN, P0, Q0, P1, Q1, TABLES = range(13)
"""Tables over the lines: Phi (and AT: at which field), exp(-attempts), attempts, rates at start and end of a step."""


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
        attempts: Phi and its slope times the spacing, see `attempts_table`.
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


def attempts_table() -> Array:
    """Phi and Phi'/32 for z = -6.5, -6.5 + 1/32, ... 14; shape (m, 2)."""
    z = np.arange(_FIRST, _LAST + 0.5 / _PER_UNIT, 1 / _PER_UNIT)
    phi = -0.5 * _ROOT_PI * special.log_ndtr(-math.sqrt(2.0) * z)
    return np.stack([phi, 1 / special.erfcx(z) / _PER_UNIT], axis=1)


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_phi(phi, relays, u, sign):  # type: ignore[no-untyped-def]
    """Phi(sign (u - line)) by cubic Hermite interpolation; 0 far below, constant far above."""
    table, last = relays.attempts, relays.attempts.shape[0] - 2
    for k in range(phi.size):
        place = (sign * (u - relays.lines[k]) - _FIRST) * _PER_UNIT
        inside = min(max(place, 0.0), last + 0.999999)
        node = int(inside)
        t = inside - node
        f0, f1, s0, s1 = table[node, 0], table[node + 1, 0], table[node, 1], table[node + 1, 1]
        rise = f1 - f0
        value = f0 + t * (s0 + t * (3.0 * rise - 2.0 * s0 - s1 + t * (s0 + s1 - 2.0 * rise)))
        phi[k] = value if place > 0.0 else 0.0


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_attempts(many, phi, relays, u0, u1, sign, clock):  # type: ignore[no-untyped-def]
    """Attempts of every line while the field goes from u0 to u1 in `clock` relaxation times.

    Moves `phi` from u0 to u1, except in what is almost a hold.
    """
    climb = sign * (u1 - u0)
    middle = 0.5 * (u0 + u1)
    if abs(climb) < _LEVEL:
        for k in range(many.size):
            many[k] = clock * switching_rate(sign * (middle - relays.lines[k]))
        return
    many[:] = phi
    _fill_phi(phi, relays, u1, sign)
    lowest = min(sign * u0, sign * u1)
    for k in range(many.size):
        z = sign * (middle - relays.lines[k])
        mean = (phi[k] - many[k]) / climb
        many[k] = clock * (_ROOT_PI * (z + 0.5 / z) if lowest - sign * relays.lines[k] > _STEEP else max(mean, 0.0))


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_rates(rates, relays, u, sign, first, last):  # type: ignore[no-untyped-def]
    """1/erfcx(sign (u - line)) for lines first ... last."""
    for k in range(first, last + 1):
        rates[k] = switching_rate(sign * (u - relays.lines[k]))


@njit(cache=True, error_model="numpy", fastmath=True)
def _fill_tables(work, relays, u0, u1, clock, first, last):  # type: ignore[no-untyped-def]
    """All tables of a substep; rates at its ends only for lines first ... last."""
    _fill_attempts(work[MANY_UP], work[PHI_UP], relays, u0, u1, 1.0, clock)
    _fill_attempts(work[MANY_DOWN], work[PHI_DOWN], relays, u0, u1, -1.0, clock)
    work[AT, 0] = u1 if abs(u1 - u0) >= _LEVEL else u0
    n = relays.lines.size
    for k in range(n):
        work[UP, k] = exponential(-work[MANY_UP, k])
    for k in range((n + 1) // 2):
        work[DOWN_EVEN, k] = exponential(-work[MANY_DOWN, 2 * k])
    for k in range(n // 2):
        work[DOWN_ODD, k] = exponential(-work[MANY_DOWN, 2 * k + 1])
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
def _move(x, left, work, n, first, last):  # type: ignore[no-untyped-def]
    """One substep of every relay, and of the share `left` of its start where that is followed, in place."""
    follow = left.size > 0
    for i in range(1, n):
        begin, count, odd = i * i // 4, (i + 1) // 2, (i + 1) % 2
        stay = work[UP, i]
        fall = work[DOWN_ODD, :count] if odd else work[DOWN_EVEN, :count]
        r = x[begin : begin + count]
        far = count  # relays before this one are too high or too far to feel both rates
        if first < i <= last:
            far = max(0, (first - odd + 1) // 2)
            for k in range(far, count):
                r[k] = _balanced(r[k], stay * fall[k], work, i, 2 * k + odd)
        for k in range(far):
            r[k] = (1.0 - (1.0 - r[k]) * stay) * fall[k]
        if follow:
            share = left[begin : begin + count]
            for k in range(count):
                still = share[k] * (stay * fall[k])
                share[k] = still if still > _FORGOTTEN else 0.0


@njit(cache=True, error_model="numpy")
def advance(x, left, relays, work, start, end, duration):  # type: ignore[no-untyped-def]
    """Take all x, in place, through a linear ramp from start to end [V/m] in duration [s].

    Args:
        x: of every relay [-].
        left: what is left of each x(0) [-, as x], or an empty array where nobody wants to know.
        work: shape (TABLES, n).
    """
    if duration == 0.0:
        return
    n, spacing = relays.lines.size, relays.lines[1] - relays.lines[0]
    u0 = start / relays.width
    climb = (end - start) / relays.width
    count = int(min(max(math.ceil(abs(climb) / relays.field_step), 1.0), _MAX_SUBSTEPS))
    clock = duration * relays.attempt_rate / count
    reach = math.sqrt(max(math.log(0.5 * clock / _FEW), 1.0))
    if work[AT, 0] != u0:
        _fill_phi(work[PHI_UP], relays, u0, 1.0)
        _fill_phi(work[PHI_DOWN], relays, u0, -1.0)
    before = u0
    for k in range(count):
        after = u0 + climb * (k + 1) / count if k < count - 1 else end / relays.width
        lowest, highest = min(before, after) - reach, max(before, after) + reach
        first = int(max(0, math.ceil((lowest - relays.lines[0]) / spacing)))
        last = int(min(n - 1, math.floor((highest - relays.lines[0]) / spacing)))
        _fill_tables(work, relays, before, after, clock, first, last)
        _move(x, left, work, n, first, last)
        before = after


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
    remains = np.empty_like(left)
    for k in range(time.size):
        if not _is_usable(time[k], voltage[k], state, relays):
            return k
        _sample(state, left, relays, work, time[k], voltage[k])
        switched = weighted_sum(state[HEAD:], relays.weight)
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
            trial[:] = state
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
