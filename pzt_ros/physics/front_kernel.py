"""Two switching fronts and an Everett table: the compiled loops of the front model (methods.md 3.2).

In the plane of thresholds all domains with a < u have gone up and all with b > l have gone down, and the order in which
this happened is all that the ceramic remembers. One front, u or l, is the leader: it is pushed by the field; the other
follows it as its mirror image at the field, 2 E - u, for domains between the two flip to and fro and are in
equilibrium, up where E_e > -E. A follower that cannot keep up (by the dead band) takes the lead: the old leader's
position becomes a turning point. A leader that reaches the turning point before the last wipes both out.

Everything is written for the up-going leader. With s = -1 the same code serves the down-going one, on fields and
positions times s; turning points are kept as they are. Lengths are in units of d, times in units of tau.

Fronts are not sharp: half of the domains within d or so of a front have switched. Each front therefore counts as two
hard sub-fronts (front_kinetics.profile_table), and shares are averages over the 2 x 2 pairs.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pzt_ros.physics.front_kinetics import (
    HIGH,
    LOW,
    REACH,
    SHARE,
    entry,
    merge,
    move,
    relative_attempts,
    row_of,
)
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, UPPER
from pzt_ros.physics.signals import Array

TURNS = 512
"""Turning points that fit into the memory: 256 pairs."""

TIME, VOLTAGE, STEEPNESS, FRACTION, DIRECTION, DEPTH, LEADER, LEAD, FOLLOWER, FOLLOWER_LEAD, SLAVED, HEAD = range(12)
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], x+ [-], +1, -1 or 0 (virgin), number of
turning points; leader and follower with their leads [units of d], on which follow TURNS positions, leads and sums."""

LEADS, SUM, STATE_SIZE = HEAD + TURNS, HEAD + 2 * TURNS, HEAD + 3 * TURNS

_LEFT_BEHIND = 2.0  # [d]; a leader that the field has fallen below by less is still switching
_CLOSED = 1.2  # relative attempts of a turning point at a leader that has reached it
_ROOM = 30.0  # [d]; a new leader this far back has not moved at all
_SAME = 1e-13  # of x+
_MAX_SUBSTEPS = 100_000
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]; a hundred times what breaks a ceramic
_FAR = 1e6  # [d]; where the turning point before the virgin state lies


class Fronts(NamedTuple):
    """The material as the loops want it.

    Attributes:
        table: see front_kinetics.front_table.
        shares: see front_tables.Everett.values.
        per: grid steps per d.
        initial: share of domains up in the virgin state [-].
        width: d [V/m].
        attempt_rate: 1/tau [1/s].
        susceptibility: 1/E_1 [C/(V m)].
        domain_polarization: P_T [C/m^2].
        bias: polarization that the interaction fields alone would make [C/m^2].
        layer_thickness: [m].
        dead_band: [d].
        field_step: longest substep [d].
    """

    table: Array
    shares: Array
    per: float
    initial: float
    width: float
    attempt_rate: float
    susceptibility: float
    domain_polarization: float
    bias: float
    layer_thickness: float
    dead_band: float
    field_step: float


@njit(cache=True, inline="always", error_model="numpy")
def _weights(t):  # type: ignore[no-untyped-def]
    """Cubic Hermite: of both values and of both slopes."""
    t2 = t * t
    value = t2 * (3.0 - 2.0 * t)
    slope = t2 * (t - 1.0)
    return 1.0 - value, value, slope - t2 + t, slope


@njit(cache=True, inline="always", error_model="numpy")
def _locate(t, last):  # type: ignore[no-untyped-def]
    """Cell of a position in grid steps, and how far into it."""
    t = min(max(t, 0.0), last)
    k = min(int(t), int(last) - 1)
    return k, t - k


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _contract(f, share, i, j, a, b):  # type: ignore[no-untyped-def]
    """Bicubic Hermite sum over a cell with the weights of u (a) and l (b)."""
    i, j = np.uint64(i), np.uint64(j)  # Numba spares the test for negative indices
    k, m = i + np.uint64(1), j + np.uint64(1)
    b0, b1, b2, b3 = b
    return (
        a[0] * (b0 * f[share, i, j, 0] + b1 * f[share, i, m, 0] + b2 * f[share, i, j, 2] + b3 * f[share, i, m, 2])
        + a[1] * (b0 * f[share, k, j, 0] + b1 * f[share, k, m, 0] + b2 * f[share, k, j, 2] + b3 * f[share, k, m, 2])
        + a[2] * (b0 * f[share, i, j, 1] + b1 * f[share, i, m, 1] + b2 * f[share, i, j, 3] + b3 * f[share, i, m, 3])
        + a[3] * (b0 * f[share, k, j, 1] + b1 * f[share, k, m, 1] + b2 * f[share, k, j, 3] + b3 * f[share, k, m, 3])
    )


@njit(cache=True, error_model="numpy")
def _hard(f, share, u, l):  # type: ignore[no-untyped-def]
    """A share for hard fronts at u and l [grid steps]."""
    if u <= l:
        return 0.0
    last = f.shape[1] - 1.0
    i, s = _locate(u, last)
    j, t = _locate(l, last)
    return _contract(f, share, i, j, _weights(s), _weights(t))


@njit(cache=True, inline="always", error_model="numpy")
def _mixed(w, s1, s2):  # type: ignore[no-untyped-def]
    """Weights of two places in one cell."""
    a0, a1, a2, a3 = _weights(s1)
    b0, b1, b2, b3 = _weights(s2)
    return b0 + w * (a0 - b0), b1 + w * (a1 - b1), b2 + w * (a2 - b2), b3 + w * (a3 - b3)


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _mean(f, share, u1, u2, w, l1, l2, v):  # type: ignore[no-untyped-def]
    """Mean of four pairs of hard fronts: u1 has the weight w and u2 the rest, l1 v and l2 the rest [grid steps].

    Mostly both u and both l lie in a cell; one sum over it then does for all four.
    """
    if max(u1, u2) <= min(l1, l2):
        return 0.0
    last = f.shape[1] - 1.0
    i, s1 = _locate(u1, last)
    i2, s2 = _locate(u2, last)
    j, t1 = _locate(l1, last)
    j2, t2 = _locate(l2, last)
    if i == i2 and j == j2 and min(u1, u2) >= max(l1, l2):
        return _contract(f, share, i, j, _mixed(w, s1, s2), _mixed(v, t1, t2))
    first = v * _hard(f, share, u1, l1) + (1.0 - v) * _hard(f, share, u1, l2)
    second = v * _hard(f, share, u2, l1) + (1.0 - v) * _hard(f, share, u2, l2)
    return w * first + (1.0 - w) * second


@njit(cache=True, inline="always", error_model="numpy")
def _places(table, u, lead):  # type: ignore[no-untyped-def]
    """Where the two sub-fronts of a front are, and the share of the first."""
    k, t = row_of(table, lead)
    return u + entry(table, k, t, LOW), u + entry(table, k, t, HIGH), entry(table, k, t, SHARE)


@njit(cache=True, inline="always", error_model="numpy")
def _everett(fr, s, u, lead, l, lead_l):  # type: ignore[no-untyped-def]
    """T of fronts with profiles [-]."""
    u1, u2, w = _places(fr.table, u, lead)
    l1, l2, v = _places(fr.table, -l, lead_l)
    middle, per = 0.5 * (fr.shares.shape[1] - 1), fr.per
    u1, u2, l1, l2 = u1 * per, u2 * per, l1 * per, l2 * per
    if s < 0.0:
        u1, u2, w, l1, l2, v = l1, l2, v, u1, u2, w
    return _mean(fr.shares, TRIANGLE, middle + u1, middle + u2, w, middle - l1, middle - l2, v)


@njit(cache=True, inline="always", error_model="numpy")
def _equilibrium(fr, s, u, lead, field):  # type: ignore[no-untyped-def]
    """Share of the domains between a front and its mirror image at the field that are down: the far half [-].

    This and the same for the mirrored front add up to T: the two fronts may change roles without a jump.
    """
    u1, u2, w = _places(fr.table, u - field, lead)
    u1, u2 = u1 * fr.per, u2 * fr.per
    at = 0.5 * (fr.shares.shape[1] - 1) + s * field * fr.per
    return _mean(fr.shares, LOWER if s > 0.0 else UPPER, at + u1, at + u2, w, at - u1, at - u2, w)


@njit(cache=True, error_model="numpy")
def _virgin(f, per, s, u, l):  # type: ignore[no-untyped-def]
    """Turned x - initial of hard fronts in a virgin specimen: first down to l, then up to u."""
    middle = 0.5 * (f.shape[1] - 1)
    up, down = (LOWER, UPPER) if s > 0.0 else (UPPER, LOWER)
    if u > -l:
        return _hard(f, up, middle + u * per, middle - u * per)
    before = _hard(f, down, middle - l * per, middle + l * per)
    if s < 0.0:
        u, l = -l, -u
    return _hard(f, TRIANGLE, middle + u * per, middle + l * per) - before


@njit(cache=True, error_model="numpy")
def _leg(fr, k, s, u, lead, l, lead_l):  # type: ignore[no-untyped-def]
    """What the way from turning point k - 1 (at l) to k (at u) adds to x, in turned positions."""
    if k > 1:
        return s * _everett(fr, s, u, lead, l, lead_l)
    u1, u2, w = _places(fr.table, u, lead)
    l1, l2, v = _places(fr.table, -l, lead_l)
    f, per = fr.shares, fr.per
    first = v * _virgin(f, per, s, u1, -l1) + (1.0 - v) * _virgin(f, per, s, u1, -l2)
    second = v * _virgin(f, per, s, u2, -l1) + (1.0 - v) * _virgin(f, per, s, u2, -l2)
    return s * (w * first + (1.0 - w) * second)


@njit(cache=True, error_model="numpy")
def _history(state, fr, u, lead, keep):  # type: ignore[no-untyped-def]
    """Sum of all legs up to the last turning point, as the leader (at turned u) has changed them.

    Turning points in the leader's direction that lie within its profile merge with it; `keep` writes that down.
    """
    n, s = int(state[DEPTH]), state[DIRECTION]
    row, t = row_of(fr.table, lead)
    ahead = u + entry(fr.table, row, t, REACH)
    first = n
    while first >= 2 and s * state[HEAD + first - 2] < ahead:
        first -= 2
    if first == n:
        return state[SUM + n - 1]
    before, before_lead = 0.0, 0.0
    x = 0.0
    if first > 0:
        before, before_lead, x = state[HEAD + first - 1], state[LEADS + first - 1], state[SUM + first - 1]
    for k in range(first, n):
        at, at_lead, side = state[HEAD + k], state[LEADS + k], -s
        if (k - first) % 2 == 0:
            side = s
            at, at_lead = merge(fr.table, s * at, at_lead, u, lead)
            at *= s
        if k > 0:
            x += _leg(fr, k, side, side * at, at_lead, side * before, before_lead)
        before, before_lead = at, at_lead
        if keep:
            state[HEAD + k], state[LEADS + k], state[SUM + k] = at, at_lead, x
    return x


@njit(cache=True, error_model="numpy")
def _fraction(state, fr, field):  # type: ignore[no-untyped-def]
    """x+ [-] at a turned field [d]."""
    n, s = int(state[DEPTH]), state[DIRECTION]
    u, lead, l, lead_l = state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD]
    last, last_lead = s * state[HEAD + n - 1], state[LEADS + n - 1]
    x = fr.initial + _history(state, fr, u, lead, False)
    x += _leg(fr, n, s, u, lead, last, last_lead)
    if state[SLAVED] > 0.0:
        return x - s * _equilibrium(fr, s, u, lead, field)
    mirror = 2.0 * field - l
    down = _equilibrium(fr, s, mirror, lead_l, field)
    down += _everett(fr, s, u, lead, l, lead_l) - _everett(fr, s, mirror, lead_l, l, lead_l)
    return x - s * down


@njit(cache=True, error_model="numpy")
def _close(state, fr, field):  # type: ignore[no-untyped-def]
    """Wipe out the turning points that the leader has passed, moving it so that x+ stays."""
    while state[DEPTH] >= 2:
        n, s = int(state[DEPTH]), state[DIRECTION]
        u, lead = state[LEADER], state[LEAD]
        passed, passed_lead = s * state[HEAD + n - 2], state[LEADS + n - 2]
        if passed > u + 1.0 or (passed > u and relative_attempts(fr.table, passed, passed_lead, u) > _CLOSED):
            return
        x = s * _fraction(state, fr, field)
        top, top_lead = merge(fr.table, passed, passed_lead, u, lead)
        if n == 2:  # in a virgin specimen the other side's extreme goes on to count
            state[HEAD], state[LEADS] = state[HEAD + 1], state[LEADS + 1]
        _forget(state, max(n - 2, 1))
        _settle(state, fr, field, x, top, top_lead)


@njit(cache=True, error_model="numpy")
def _settle(state, fr, field, x, far, far_lead):  # type: ignore[no-untyped-def]
    """Move the leader towards `far` until turned x+ is what it was, by regula falsi (Illinois)."""
    s = state[DIRECTION]
    near, near_lead = state[LEADER], state[LEAD]
    low, low_miss = 0.0, s * _fraction(state, fr, field) - x
    if abs(low_miss) < _SAME:
        return
    _place(state, far, far_lead, field)
    high, high_miss = 1.0, s * _fraction(state, fr, field) - x
    if low_miss * high_miss > 0.0:  # hardly anything depends on where the leader is
        if abs(low_miss) < abs(high_miss):
            _place(state, near, near_lead, field)
        return
    for _ in range(60):
        share = low + (high - low) * low_miss / (low_miss - high_miss)
        _place(state, near + share * (far - near), near_lead + share * (far_lead - near_lead), field)
        miss = s * _fraction(state, fr, field) - x
        if abs(miss) < _SAME:
            return
        if miss * low_miss > 0.0:
            low, low_miss, high_miss = share, miss, 0.5 * high_miss
        else:
            high, high_miss, low_miss = share, miss, 0.5 * low_miss


@njit(cache=True, error_model="numpy")
def _place(state, u, lead, field):  # type: ignore[no-untyped-def]
    """Put the leader somewhere; a slaved follower goes with it."""
    state[LEADER], state[LEAD] = u, lead
    if state[SLAVED] > 0.0:
        state[FOLLOWER], state[FOLLOWER_LEAD] = 2.0 * field - u, lead


@njit(cache=True, error_model="numpy")
def _turn(state, fr, field):  # type: ignore[no-untyped-def]
    """The leader becomes a turning point and the follower leads; drops the innermost pair when the memory is full."""
    s = state[DIRECTION]
    u, lead = state[LEADER], state[LEAD]
    x = _fraction(state, fr, field)
    total = _history(state, fr, u, lead, True)
    n = int(state[DEPTH])
    if n == TURNS:
        n -= 2
        _forget(state, n)
        total = state[SUM + n - 1]
    total += _leg(fr, n, s, u, lead, s * state[HEAD + n - 1], state[LEADS + n - 1])
    state[HEAD + n], state[LEADS + n], state[SUM + n] = s * u, lead, total
    state[DEPTH] = n + 1
    state[DIRECTION] = -s
    state[SLAVED] = 1.0
    leader, lead = -state[FOLLOWER], state[FOLLOWER_LEAD]
    _place(state, leader, lead, -field)
    # as a leader it merges with the turning points that it comes near to; it did not as a follower
    _settle(state, fr, -field, -s * x, leader - _ROOM, lead)


@njit(cache=True, error_model="numpy")
def _substep(state, fr, start, end, duration):  # type: ignore[no-untyped-def]
    """Both fronts through a linear piece of field [d] in a time [tau]."""
    s = state[DIRECTION]
    y0, y1 = s * start, s * end
    u, lead = state[LEADER], state[LEAD]
    follower, follower_lead = state[FOLLOWER], state[FOLLOWER_LEAD]
    slaved = state[SLAVED] > 0.0 and y1 >= y0  # then the mirror image stays ahead of the follower
    if duration > 0.0:
        u, lead = move(fr.table, u, lead, y0, y1, duration)
        if not slaved:
            follower, follower_lead = move(fr.table, -follower, follower_lead, -y0, -y1, duration)
            follower = -follower
    mirror = 2.0 * y1 - u
    slaved = slaved or follower <= mirror
    if slaved:
        follower, follower_lead = mirror, lead
    state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD] = u, lead, follower, follower_lead
    state[SLAVED] = 1.0 if slaved else 0.0
    _close(state, fr, y1)
    if follower > mirror + fr.dead_band and u - y1 > _LEFT_BEHIND:
        _turn(state, fr, y1)
        _close(state, fr, -y1)


@njit(cache=True, error_model="numpy")
def _advance_far(state, fr, first, last, time):  # type: ignore[no-untyped-def]
    """Any ramp between two fields [d], in substeps; returns x+."""
    count = int(min(max(math.ceil(abs(last - first) / fr.field_step), 1.0), _MAX_SUBSTEPS))
    if time == 0.0:
        count = 1
    before = first
    for k in range(1, count + 1):
        after = last if k == count else first + (last - first) * k / count
        _substep(state, fr, before, after, time / count)
        before = after
    return _fraction(state, fr, state[DIRECTION] * last)


@njit(cache=True, inline="always", error_model="numpy")
def _advance(state, fr, end, duration):  # type: ignore[no-untyped-def]
    """Take the state through a linear ramp to the field `end` [V/m] in `duration` [s]; returns x+.

    The usual case goes without detours: a short step onwards, with no turning point near.
    """
    first, last = state[VOLTAGE] / fr.layer_thickness / fr.width, end / fr.width
    time = duration * fr.attempt_rate
    if state[DIRECTION] == 0.0:  # virgin: the first move decides who leads
        state[DIRECTION] = 1.0 if last >= first else -1.0
        state[HEAD] = state[DIRECTION] * _FAR
    s, n = state[DIRECTION], int(state[DEPTH])
    climb = s * (last - first)
    done = False
    x = 0.0
    if n > 1 and state[SLAVED] > 0.0 and 0.0 <= climb <= fr.field_step and time > 0.0:
        y = s * last
        u, lead = move(fr.table, state[LEADER], state[LEAD], s * first, y, time)
        row, t = row_of(fr.table, lead)
        if s * state[HEAD + n - 2] >= u + max(entry(fr.table, row, t, REACH), 1.0):
            state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD] = u, lead, 2.0 * y - u, lead
            x = _everett(fr, s, u, lead, s * state[HEAD + n - 1], state[LEADS + n - 1])
            x = fr.initial + state[SUM + n - 1] + s * (x - _equilibrium(fr, s, u, lead, y))
            done = True
    if not done:
        x = _advance_far(state, fr, first, last, time)
    x = min(max(x, 0.0), 1.0)
    state[FRACTION] = x
    return x


@njit(cache=True, error_model="numpy")
def virgin(state, fr):  # type: ignore[no-untyped-def]
    """Fill in the state of a virgin specimen at zero field."""
    state[DEPTH], state[SLAVED], state[FRACTION] = 1.0, 1.0, fr.initial


@njit(cache=True, error_model="numpy")
def _polarization(x, field, fr):  # type: ignore[no-untyped-def]
    return field * fr.susceptibility + fr.bias + (2.0 * x - 1.0) * fr.domain_polarization


@njit(cache=True, error_model="numpy")
def run(state, fr, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    for k in range(time.size):
        duration = time[k] - state[TIME]
        field = voltage[k] / fr.layer_thickness
        if not (duration >= 0.0 and math.isfinite(time[k]) and abs(field) <= _NO_SUCH_FIELD):
            return k
        x = _advance(state, fr, field, duration)
        state[TIME], state[VOLTAGE] = time[k], voltage[k]
        phase_fraction[k] = x
        polarization[k] = _polarization(x, field, fr)
    return -1


@njit(cache=True, error_model="numpy")
def _forget(state, n):  # type: ignore[no-untyped-def]
    """Keep the first n turning points; what lies above is 0, so that equal histories are equal states."""
    for k in range(n, int(state[DEPTH])):
        state[HEAD + k], state[LEADS + k], state[SUM + k] = 0.0, 0.0, 0.0
    state[DEPTH] = n


@njit(cache=True, error_model="numpy")
def _copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a state, only as deep as its memory is filled."""
    n = int(source[DEPTH])
    _forget(target, min(n, int(target[DEPTH])))
    target[:HEAD] = source[:HEAD]
    for k in range(n):
        target[HEAD + k], target[LEADS + k], target[SUM + k] = source[HEAD + k], source[LEADS + k], source[SUM + k]


@njit(cache=True, error_model="numpy")
def run_inverse(state, fr, time, target, voltage, phase_fraction, limit, tolerance):  # type: ignore[no-untyped-def]
    """Find the voltage at the end of each sample that gives the target polarization [C/m^2]; otherwise as `run`.

    P rises with the voltage, at least as steeply as without switching, and a root lies within +-limit [V] or beyond:
    then the limit is the answer. The first trial continues with the last sample's slope, then secants; bisection where
    they leave the bracket or do not halve it in three.
    """
    trial_state = state.copy()
    least_slope = fr.susceptibility / fr.layer_thickness
    for k in range(time.size):
        duration = time[k] - state[TIME]
        if not (duration >= 0.0 and math.isfinite(time[k])):
            return k
        start = state[VOLTAGE]
        known = math.isfinite(target[k])
        way = target[k] - _polarization(state[FRACTION], start / fr.layer_thickness, fr)
        v = min(max(start + way / max(state[STEEPNESS], least_slope), -limit), limit) if known else start
        low, high, checked = -limit, limit, 4.0 * limit
        slope, v_old, miss_old, miss = least_slope, 0.0, 0.0, 0.0
        for trial in range(_MAX_TRIALS):
            _copy(state, trial_state)
            field = v / fr.layer_thickness
            x = _advance(trial_state, fr, field, duration)
            miss = _polarization(x, field, fr) - target[k]
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
        trial_state[TIME], trial_state[VOLTAGE] = time[k], v
        if known and abs(v - start) > 1e-9 * limit:
            trial_state[STEEPNESS] = max((way + miss) / (v - start), least_slope)
        _copy(trial_state, state)
        voltage[k] = v
        phase_fraction[k] = state[FRACTION]
    return -1
