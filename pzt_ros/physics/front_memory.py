"""What the front model remembers: its state, turning points, and how they are made, merged and wiped out.

Everything is written for the up-going leader. With s = -1 the same code serves the down-going one, on fields and
positions times s; turning points are kept as they are. Lengths are in units of d, times in units of tau.
"""

# ruff: noqa: E741 - u and l are the symbols of the Everett function

from __future__ import annotations

import numpy as np

from pzt_ros.physics.front_kinetics import REACH, entry, inlined, inner, merge, relative_attempts, row_of, unfolded
from pzt_ros.physics.front_shares import Fronts, between, everett, leg, places
from pzt_ros.physics.front_tables import LOWER, UPPER
from pzt_ros.physics.signals import Array

TURNS = 512
"""Turning points that fit into the memory: 256 pairs."""

TIME, VOLTAGE, STEEPNESS, FRACTION, DIRECTION, DEPTH, LEADER, LEAD, FOLLOWER, FOLLOWER_LEAD, SLAVED, HEAD = range(12)
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], x+ [-], direction of the
leader (0: virgin), number of turning points; leader and follower with their leads [d], whether the follower is a mirror
image; then TURNS positions, leads [d] and sums [-] of the turning points."""

LEADS, SUM, STATE_SIZE = HEAD + TURNS, HEAD + 2 * TURNS, HEAD + 3 * TURNS

FAR = 1e6  # [d]; where the turning point before the virgin state lies
_CLOSED = 1.2  # relative attempts of a turning point at a leader that has reached it
_ROOM = 30.0  # [d]; a new leader this far back has not moved at all
_NEXT = 0.1  # [d]; most give way by less as they begin to lead
_SAME = 1e-11  # of x+


def virgin(fr: Fronts, all_up: bool) -> Array:
    """State at time 0 and zero field: up where E_e >= 0; or all up, which is that where no E_e differs from 0."""
    state = np.zeros(STATE_SIZE)
    state[DEPTH], state[SLAVED], state[FRACTION] = 1.0, 1.0, fr.initial
    if all_up:
        state[HEAD], state[DIRECTION], state[FRACTION] = FAR, -1.0, 1.0
        state[LEADER], state[FOLLOWER] = -_ROOM, _ROOM
    return state


@inner
def history(state, fr, u, lead, kept):  # type: ignore[no-untyped-def]
    """Sum of all legs up to the last turning point, as the leader (at turned u) has changed them.

    Turning points in the leader's direction that lie within its profile merge with it; that is written to the state
    `kept`, or if that is empty nowhere.
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
        if kept.size > 0:
            kept[HEAD + k], kept[LEADS + k], kept[SUM + k] = at, at_lead, x
    return x


@inner
def fraction(state, fr, field):  # type: ignore[no-untyped-def]
    """x+ [-] at a turned field [d]."""
    n, s = int(state[DEPTH]), state[DIRECTION]
    u, lead, l = state[LEADER], state[LEAD], state[FOLLOWER]
    x = fr.initial + history(state, fr, u, lead, state[:0])
    x += leg(fr, n, s, u, lead, s * state[HEAD + n - 1], state[LEADS + n - 1])
    f = fr.shares[0] if s > 0.0 else fr.shares[1]
    profile = places(fr.table, lead)
    if state[SLAVED] > 0.0:
        return x - s * between(f, LOWER, fr.per, u, profile, field)
    other = places(fr.table, state[FOLLOWER_LEAD])
    down = everett(f, fr.per, u, profile, l, other) - between(f, UPPER, fr.per, 2.0 * field - l, other, field)
    return x - s * down


@inner
def reached(table, passed, lead, u):  # type: ignore[no-untyped-def]
    """Whether a leader at u has come to a turning point."""
    return passed <= u or (passed <= u + 1.0 and relative_attempts(table, passed, lead, u) <= _CLOSED)


@unfolded
def close(state, fr, field):  # type: ignore[no-untyped-def]
    """Wipe out the turning points that the leader has passed, moving it so that x+ stays."""
    while state[DEPTH] >= 2:
        n, s = int(state[DEPTH]), state[DIRECTION]
        u, lead = state[LEADER], state[LEAD]
        passed, passed_lead = s * state[HEAD + n - 2], state[LEADS + n - 2]
        if not reached(fr.table, passed, passed_lead, u):
            return
        x = s * fraction(state, fr, field)
        top, top_lead = merge(fr.table, passed, passed_lead, u, lead)
        if n == 2:  # in a virgin specimen the other side's extreme goes on to count
            state[HEAD], state[LEADS] = state[HEAD + 1], state[LEADS + 1]
        _forget(state, max(n - 2, 1))
        _settle(state, fr, field, x, top, top_lead)


@inner
def _settle(state, fr, field, x, far, far_lead):  # type: ignore[no-untyped-def]
    """Move the leader towards `far` until turned x+ is what it was (Illinois); whether it comes about on the way."""
    s = state[DIRECTION]
    near, near_lead = state[LEADER], state[LEAD]
    low, low_miss = 0.0, s * fraction(state, fr, field) - x
    if abs(low_miss) < _SAME:
        return True
    _place(state, far, far_lead, field)
    high, high_miss = 1.0, s * fraction(state, fr, field) - x
    if low_miss * high_miss > 0.0:  # hardly anything depends on where the leader is
        if abs(low_miss) < abs(high_miss):
            _place(state, near, near_lead, field)
        return False
    side = 0.0  # on which the last trial fell
    for _ in range(60):
        share = low + (high - low) * low_miss / (low_miss - high_miss)
        _place(state, near + share * (far - near), near_lead + share * (far_lead - near_lead), field)
        miss = s * fraction(state, fr, field) - x
        if abs(miss) < _SAME:
            break
        if miss * low_miss > 0.0:
            low, low_miss = share, miss
            high_miss *= 0.5 if side < 0.0 else 1.0  # an end that stays twice holds the trials back
            side = -1.0
        else:
            high, high_miss = share, miss
            low_miss *= 0.5 if side > 0.0 else 1.0
            side = 1.0
    return True


@inner
def _place(state, u, lead, field):  # type: ignore[no-untyped-def]
    """Put the leader somewhere; a slaved follower goes with it."""
    state[LEADER], state[LEAD] = u, lead
    if state[SLAVED] > 0.0:
        state[FOLLOWER], state[FOLLOWER_LEAD] = 2.0 * field - u, lead


@unfolded
def turn(state, fr, field):  # type: ignore[no-untyped-def]
    """The leader becomes a turning point and the follower leads; drops the innermost pair when the memory is full."""
    s = state[DIRECTION]
    u, lead = state[LEADER], state[LEAD]
    x = fraction(state, fr, field)
    total = history(state, fr, u, lead, state)
    n = int(state[DEPTH])
    if n == TURNS:
        n -= 2
        _forget(state, n)
        total = state[SUM + n - 1]
    total += leg(fr, n, s, u, lead, s * state[HEAD + n - 1], state[LEADS + n - 1])
    state[HEAD + n], state[LEADS + n], state[SUM + n] = s * u, lead, total
    state[DEPTH] = n + 1
    if fr.nearest > 0.0:
        _thin_out(state, fr.nearest)
    state[DIRECTION] = -s
    state[SLAVED] = 1.0
    leader, lead = -state[FOLLOWER], state[FOLLOWER_LEAD]
    _place(state, leader, lead, -field)
    # as a leader it merges with the turning points that it comes near to; it did not as a follower
    if not _settle(state, fr, -field, -s * x, leader - _NEXT, lead):
        _place(state, leader, lead, -field)
        _settle(state, fr, -field, -s * x, leader - _ROOM, lead)


@inner
def _thin_out(state, nearest):  # type: ignore[no-untyped-def]
    """Take a loop out wherever it is nearly the next one outside: both ends are no further apart than `nearest` [d].

    What is lost is the share of a rectangle with such sides. Else a chirp, whose loops come to lie closer and closer,
    has every sample merge with a dozen of them.
    """
    n = int(state[DEPTH])
    kept = min(n, 3)  # how many; the first three belong to the way from the virgin state
    for k in range(3, n):
        _move(state, k, kept)
        if kept > 4 and _are_near(state, kept, nearest) and _are_near(state, kept - 1, nearest):
            kept -= 2
            _move(state, k, kept)
        kept += 1
    _forget(state, kept)


@inlined
def _are_near(state, k, nearest):  # type: ignore[no-untyped-def]
    """Whether a turning point is near the one before it on the same side."""
    return abs(state[HEAD + k] - state[HEAD + k - 2]) < nearest


@inlined
def _move(state, k, to):  # type: ignore[no-untyped-def]
    """Move what is kept of a turning point to another place."""
    state[HEAD + to], state[LEADS + to], state[SUM + to] = state[HEAD + k], state[LEADS + k], state[SUM + k]


@inner
def _forget(state, n):  # type: ignore[no-untyped-def]
    """Keep the first n turning points; what lies above is 0, so that equal histories are equal states."""
    for k in range(n, int(state[DEPTH])):
        state[HEAD + k], state[LEADS + k], state[SUM + k] = 0.0, 0.0, 0.0
    state[DEPTH] = n


@inner
def copy(source, target):  # type: ignore[no-untyped-def]
    """Copy a state, only as deep as its memory is filled."""
    n = int(source[DEPTH])
    _forget(target, min(n, int(target[DEPTH])))
    for k in range(HEAD):  # Numba takes two seconds to compile the assignment of a slice
        target[k] = source[k]
    for k in range(n):
        target[HEAD + k], target[LEADS + k], target[SUM + k] = source[HEAD + k], source[LEADS + k], source[SUM + k]
