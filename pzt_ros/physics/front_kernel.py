"""Two switching fronts and an Everett table: the compiled loops of the front model (methods.md 3.2).

In the plane of thresholds all domains with a < u have gone up and all with b > l have gone down, and the order in which
this happened is all that the ceramic remembers. One front, u or l, is the leader: it is pushed by the field; the other
follows it as its mirror image at the field, 2 E - u, for domains between the two flip to and fro and are in
equilibrium, up where E_e > -E. A follower that cannot keep up (by the dead band) takes the lead: the old leader's
position becomes a turning point. A leader that reaches the turning point before the last wipes both out.

Everything is written for the up-going leader. With s = -1 the same code serves the down-going one, on fields and
positions times s; turning points are kept as they are. Lengths are in units of d, times in units of tau.
"""

# ruff: noqa: E741 - u and l are the symbols of the Everett function

from __future__ import annotations

import math

import numpy as np
from numba import njit

from pzt_ros.physics.front_kinetics import REACH, entry, merge, move, relative_attempts, row_of
from pzt_ros.physics.front_shares import Fronts, equilibrium, everett, leg, places
from pzt_ros.physics.signals import Array

TURNS = 512
"""Turning points that fit into the memory: 256 pairs."""

TIME, VOLTAGE, STEEPNESS, FRACTION, DIRECTION, DEPTH, LEADER, LEAD, FOLLOWER, FOLLOWER_LEAD, SLAVED, HEAD = range(12)
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], x+ [-], direction of the
leader (0: virgin), number of turning points; leader and follower with their leads [d], whether the follower is a mirror
image; then TURNS positions, leads [d] and sums [-] of the turning points."""

LEADS, SUM, STATE_SIZE = HEAD + TURNS, HEAD + 2 * TURNS, HEAD + 3 * TURNS

_LEFT_BEHIND = 2.0  # [d]; a leader that the field has fallen below by less is still switching
_CLOSED = 1.2  # relative attempts of a turning point at a leader that has reached it
_ROOM = 30.0  # [d]; a new leader this far back has not moved at all
_SAME = 1e-12  # of x+
_MAX_SUBSTEPS = 100_000
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]; a hundred times what breaks a ceramic
_FAR = 1e6  # [d]; where the turning point before the virgin state lies


def virgin(fr: Fronts, all_up: bool) -> Array:
    """State at time 0 and zero field: up where E_e >= 0; or all up, which is that where no E_e differs from 0."""
    state = np.zeros(STATE_SIZE)
    state[DEPTH], state[SLAVED], state[FRACTION] = 1.0, 1.0, fr.initial
    if all_up:
        state[HEAD], state[DIRECTION], state[FRACTION] = _FAR, -1.0, 1.0
        state[LEADER], state[FOLLOWER] = -_ROOM, _ROOM
    return state


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
            x += leg(fr, k, side, side * at, at_lead, side * before, before_lead)
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
    x += leg(fr, n, s, u, lead, last, last_lead)
    slaved = state[SLAVED] > 0.0
    mirror = u if slaved else 2.0 * field - l
    down = equilibrium(fr.shares, fr.per, s, mirror, places(fr.table, lead_l), field)
    if not slaved:
        down += s * (leg(fr, 2, s, u, lead, l, lead_l) - leg(fr, 2, s, mirror, lead_l, l, lead_l))
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
    total += leg(fr, n, s, u, lead, s * state[HEAD + n - 1], state[LEADS + n - 1])
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
def _detour(state, fr, time, voltage):  # type: ignore[no-untyped-def]
    """Go on to a sample in substeps, whatever happens on the way; returns x+."""
    first, last = state[VOLTAGE] * fr.per_volt, voltage * fr.per_volt
    duration = (time - state[TIME]) * fr.attempt_rate
    if state[DIRECTION] == 0.0:  # virgin: the first move decides who leads
        state[DIRECTION] = 1.0 if last >= first else -1.0
        state[HEAD] = state[DIRECTION] * _FAR
    count = int(min(max(math.ceil(abs(last - first) / fr.field_step), 1.0), _MAX_SUBSTEPS))
    if duration == 0.0:
        count = 1
    before = first
    for k in range(1, count + 1):
        after = last if k == count else first + (last - first) * k / count
        _substep(state, fr, before, after, duration / count)
        before = after
    x = min(max(_fraction(state, fr, state[DIRECTION] * last), 0.0), 1.0)
    state[FRACTION], state[TIME], state[VOLTAGE] = x, time, voltage
    return x


@njit(cache=True, error_model="numpy")
def _glide(state, fr, k, time, voltage, phase_fraction):  # type: ignore[no-untyped-def]
    """Go on from sample k while nothing happens: short steps onwards, no turning point near; returns where it ends.

    The same as `_detour` does, without a look at the memory for every sample.
    """
    s, n = state[DIRECTION], int(state[DEPTH])
    if state[SLAVED] == 0.0 or s == 0.0:
        return k
    table, f, per = fr.table, fr.shares, fr.per
    now, field, u, lead, x = state[TIME], s * state[VOLTAGE] * fr.per_volt, state[LEADER], state[LEAD], state[FRACTION]
    opposite, opposite_lead = s * state[HEAD + n - 1], state[LEADS + n - 1]
    behind = places(table, opposite_lead)
    base = fr.initial + state[SUM + n - 1]
    closing = s * state[HEAD + n - 2] if n > 1 else _FAR
    start = k
    while k < time.size:
        duration = (time[k] - now) * fr.attempt_rate
        y = s * voltage[k] * fr.per_volt
        if not (duration > 0.0 and 0.0 <= y - field <= fr.field_step):
            break
        moved, moved_lead = move(table, u, lead, field, y, duration)
        row, t = row_of(table, moved_lead)
        if closing < moved + max(entry(table, row, t, REACH), 1.0):
            break
        u, lead, field, now = moved, moved_lead, y, time[k]
        profile = places(table, lead)
        switched = (
            everett(f, per, s, u, profile, opposite, behind)
            if n > 1
            else s * leg(fr, 1, s, u, lead, opposite, opposite_lead)
        )
        x = min(max(base + s * (switched - equilibrium(f, per, s, u, profile, y)), 0.0), 1.0)
        phase_fraction[k] = x
        k += 1
    if k > start:
        state[TIME], state[VOLTAGE], state[FRACTION] = now, voltage[k - 1], x
        state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD] = u, lead, 2.0 * field - u, lead
    return k


@njit(cache=True, error_model="numpy")
def _polarization(x, voltage, fr):  # type: ignore[no-untyped-def]
    return voltage * fr.least_slope + fr.bias + (2.0 * x - 1.0) * fr.domain_polarization


@njit(cache=True, error_model="numpy")
def run(state, fr, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    highest = _NO_SUCH_FIELD * fr.layer_thickness
    k, bad = 0, -1
    while k < time.size:
        begun = k
        k = _glide(state, fr, k, time, voltage, phase_fraction)
        if k == begun:
            if not (time[k] >= state[TIME] and math.isfinite(time[k]) and abs(voltage[k]) <= highest):
                bad = k
                break
            phase_fraction[k] = _detour(state, fr, time[k], voltage[k])
            k += 1
    for j in range(k):
        polarization[j] = _polarization(phase_fraction[j], voltage[j], fr)
    return bad


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
    trial_state, at, trial_voltage, fraction = state.copy(), np.empty(1), np.empty(1), np.empty(1)
    least_slope = fr.least_slope
    for k in range(time.size):
        if not (time[k] >= state[TIME] and math.isfinite(time[k])):
            return k
        start = state[VOLTAGE]
        known = math.isfinite(target[k])
        way = target[k] - _polarization(state[FRACTION], start, fr)
        v = min(max(start + way / max(state[STEEPNESS], least_slope), -limit), limit) if known else start
        low, high, checked = -limit, limit, 4.0 * limit
        slope, v_old, miss_old, miss = least_slope, 0.0, 0.0, 0.0
        for trial in range(_MAX_TRIALS):
            _copy(state, trial_state)
            at[0], trial_voltage[0] = time[k], v
            if _glide(trial_state, fr, 0, at, trial_voltage, fraction) == 0:
                _detour(trial_state, fr, time[k], v)
            x = trial_state[FRACTION]
            miss = _polarization(x, v, fr) - target[k]
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
        if known and abs(v - start) > 1e-9 * limit:
            trial_state[STEEPNESS] = max((way + miss) / (v - start), least_slope)
        _copy(trial_state, state)
        voltage[k] = v
        phase_fraction[k] = state[FRACTION]
    return -1
