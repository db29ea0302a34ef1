"""The front model between events: the fronts move, no turning point is made or wiped out.

This is where nearly all samples of a measurement are, so it is made to be fast. Moving is a chain in which each sample
waits for the one before; looking up the shares is not. Done one after the other for some samples at a time, the second
fills the processor. What belongs to the turning points is fetched once; the last of them, where the leader's branch
began, stays the same, so that along the branch the Everett table is a curve of one variable, cubic in each cell.
"""

# ruff: noqa: E741 - u and l are the symbols of the Everett function

from __future__ import annotations

import math

from pzt_ros.physics.front_kinetics import (
    FIRST,
    LAST,
    NO_ATTEMPTS,
    PER_HALF,
    PER_UNIT,
    REACH,
    SHORT,
    SMALL,
    Rates,
    Slopes,
    entry,
    inlined,
    inner,
    merge,
    move,
    rate_in,
    rates_at,
    row_of,
    short_move,
    short_piece,
    slopes_at,
    unfolded,
)
from pzt_ros.physics.front_memory import (
    DEPTH,
    DIRECTION,
    FAR,
    FOLLOWER,
    FOLLOWER_LEAD,
    FRACTION,
    HEAD,
    LEAD,
    LEADER,
    LEADS,
    SLAVED,
    SUM,
    TIME,
    VOLTAGE,
    reached,
)
from pzt_ros.physics.front_shares import between, everett, first_leg, places, section, virgin_share
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, UPPER

TRACE = 128
"""Samples at a time."""

Y, U, Z, L, Z_L, SLAVE, NEAR, COLUMNS = range(8)
"""Columns of a trace: turned field, leader and its lead, follower and its lead [d], whether that is a mirror image and
whether the leader merges with a turning point."""

_LEFT_BEHIND = 2.0  # [d]; a leader that the field has fallen below by less is still switching


@unfolded
def advance(table, fronts, start, end, duration):  # type: ignore[no-untyped-def]
    """Leader and follower, with their leads, and whether the follower is a mirror image, after a piece of field."""
    u, lead, l, lead_l, slaved = fronts
    slaved = slaved and end >= start  # then the mirror image stays ahead of the follower
    if duration > 0.0:
        u, lead = move(table, u, lead, start, end, duration)
        if not slaved:
            l, lead_l = move(table, -l, lead_l, -start, -end, duration)
            l = -l
    mirror = 2.0 * end - u
    if slaved or l <= mirror:
        return u, lead, mirror, lead, True
    return u, lead, l, lead_l, False


@inlined
def left_behind(fr, u, l, field):  # type: ignore[no-untyped-def]
    """Whether the follower has to take the lead."""
    return l > 2.0 * field - u + fr.dead_band and u - field > _LEFT_BEHIND


@inner
def glide(state, fr, k, time, voltage, phase_fraction, trace):  # type: ignore[no-untyped-def]
    """Go on from sample k while nothing happens, in short steps; returns where it ends. `trace` is room for work."""
    while k < time.size:
        count = _travel(state, fr, k, time, voltage, trace)
        if count > 0:
            _look_up(state, fr, trace, phase_fraction[k : k + count])
        k += count
        if count < trace.shape[0]:
            break
    return k


@unfolded
def _travel(state, fr, k, time, voltage, trace):  # type: ignore[no-untyped-def]
    """Move the fronts from sample k on and write down where they are; returns for how many samples."""
    s, n = state[DIRECTION], int(state[DEPTH])
    now, field = state[TIME], s * state[VOLTAGE] * fr.per_volt
    fronts = state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD], state[SLAVED] > 0.0
    closing, next_closing = s * state[HEAD + n - 2] if n > 1 else FAR, s * state[HEAD + n - 4] if n > 3 else FAR
    last = min(trace.shape[0], time.size - k) if s != 0.0 else 0
    count = _march(fr, s, fronts, now, field, closing, time[k : k + last], voltage[k : k + last], trace)
    if count > 0:
        now, field = time[k + count - 1], trace[count - 1, Y]
        u, lead = trace[count - 1, U], trace[count - 1, Z]
        fronts = u, lead, 2.0 * field - u, lead, True
    for j in range(count, last):
        duration = (time[k + j] - now) * fr.attempt_rate
        y = s * voltage[k + j] * fr.per_volt
        if not (duration > 0.0 and abs(y - field) <= fr.field_step):
            break
        moved = advance(fr.table, fronts, field, y, duration)
        u, lead, l, lead_l, slaved = moved
        if not slaved and left_behind(fr, u, l, y):
            break
        row, t = row_of(fr.table, lead)
        ahead = u + max(entry(fr.table, row, t, REACH), 1.0)
        if closing < ahead and (next_closing < ahead or reached(fr.table, closing, state[LEADS + n - 2], u)):
            break
        fronts, field, now = moved, y, time[k + j]
        trace[j, Y], trace[j, U], trace[j, Z], trace[j, L], trace[j, Z_L] = y, u, lead, l, lead_l
        trace[j, SLAVE], trace[j, NEAR] = (1.0 if slaved else 0.0), (1.0 if closing < ahead else 0.0)
        count += 1
    if count > 0:
        state[TIME], state[VOLTAGE] = now, voltage[k + count - 1]
        state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD], slaved = fronts
        state[SLAVED] = 1.0 if slaved else 0.0
    return count


@unfolded
def _march(fr, s, fronts, now, field, closing, time, voltage, trace):  # type: ignore[no-untyped-def]
    """The usual case of it: the leader alone, in a field that rises in short steps, far from a turning point.

    It is `front_kinetics.move`, with the rows of the table kept at hand: each sample waits for the one before it.
    """
    table = fr.table
    u, lead = fronts[0], fronts[1]
    count = 0
    rates = Rates(-FAR, 0.0, 0.0, 0.0, 0.0)
    slopes = Slopes(-FAR, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for j in range(time.size if fronts[4] else 0):
        duration, y = (time[j] - now) * fr.attempt_rate, s * voltage[j] * fr.per_volt
        climb, z = y - field, 0.5 * (field + y) - u
        if not (duration > 0.0 and 0.0 <= climb < SHORT and FIRST <= z < LAST and FIRST <= lead < LAST):
            break
        if not 0.0 <= (z - rates.begin) * PER_UNIT < 1.0:
            rates = rates_at(table, z)
        if not 0.0 <= (lead - slopes.begin) * PER_UNIT < 1.0:
            slopes = slopes_at(table, lead)
        more, fall, fall2 = short_piece(rate_in(rates, z), z, climb, duration * PER_HALF)
        if more > SMALL:
            break
        if more >= NO_ATTEMPTS:
            ahead, change = short_move(slopes, lead, more, fall, fall2)
            u, lead = u + ahead, lead + change
        if closing < u + max(slopes.reach, 1.0):
            break
        now, field = time[j], y
        trace[j, Y], trace[j, U], trace[j, Z], trace[j, L], trace[j, Z_L] = y, u, lead, 2.0 * y - u, lead
        trace[j, SLAVE], trace[j, NEAR] = 1.0, 0.0
        count += 1
    return count


@unfolded
def _look_up(state, fr, trace, phase_fraction):  # type: ignore[no-untyped-def]
    """x+ for the first rows of a trace, as `front_memory.fraction` has it."""
    s, n = state[DIRECTION], int(state[DEPTH])
    table, per = fr.table, fr.per
    f = fr.shares[0] if s > 0.0 else fr.shares[1]
    triangle = f[TRIANGLE]
    last, middle = triangle.shape[1] - 1, 0.5 * (triangle.shape[1] - 1)
    opposite, base = s * state[HEAD + n - 1], fr.initial + state[SUM + n - 1]
    behind = places(table, state[LEADS + n - 1])
    l1, l2, v = middle + (opposite - behind[0]) * per, middle + (opposite - behind[1]) * per, behind[2]
    least, most, undone = max(l1, l2), math.inf, 0.0
    if n == 1:  # on a way back from the virgin state: further out the virgin curve goes on
        most, undone = last - least, virgin_share(f, l1, l2, v)
    closing, closing_lead, outer, before, base_near = FAR, 0.0, -FAR, behind, fr.initial
    if n > 1:
        closing, closing_lead = s * state[HEAD + n - 2], state[LEADS + n - 2]
    if n > 2:
        outer, before = s * state[HEAD + n - 3], places(table, state[LEADS + n - 3])
        base_near += state[SUM + n - 3]
    cell1 = cell2 = -1
    a = b = (0.0, 0.0, 0.0, 0.0)
    for k in range(phase_fraction.size):
        y, u, lead, l, lead_l = trace[k, Y], trace[k, U], trace[k, Z], trace[k, L], trace[k, Z_L]
        low, high, w = profile = places(table, lead)
        u1, u2 = middle + (u + low) * per, middle + (u + high) * per
        if u1 > least and u2 > least and u1 <= most and u2 <= most:
            u1, u2 = min(max(u1, 0.0), 1.0 * last), min(max(u2, 0.0), 1.0 * last)
            i, j = min(int(u1), last - 1), min(int(u2), last - 1)
            if i != cell1:
                cell1, a = i, section(triangle, i, l1, l2, v)
            if j != cell2:
                cell2, b = j, section(triangle, j, l1, l2, v)
            x = w * _cubic(a, u1 - i) + (1.0 - w) * _cubic(b, u2 - j) - undone
        elif n > 1:
            x = everett(f, per, u, profile, opposite, behind)
        else:
            x = first_leg(f, per, u, profile, opposite, behind)
        if trace[k, SLAVE] > 0.0:
            x -= between(f, LOWER, per, u, profile, y)
        else:
            other = places(table, lead_l)
            x -= everett(f, per, u, profile, l, other) - between(f, UPPER, per, 2.0 * y - l, other, y)
        start = base
        if trace[k, NEAR] > 0.0:
            start = base_near
            top, top_lead = merge(table, closing, closing_lead, u, lead)
            merged = places(table, top_lead)
            if n == 2:
                x -= first_leg(fr.shares[1] if s > 0.0 else fr.shares[0], per, -opposite, behind, -top, merged)
            else:
                x -= everett(f, per, top, merged, opposite, behind)
            if n == 3:
                x += first_leg(f, per, top, merged, outer, before)
            elif n > 3:
                x += everett(f, per, top, merged, outer, before)
        phase_fraction[k] = min(max(start + s * x, 0.0), 1.0)
    state[FRACTION] = phase_fraction[-1]


@inlined
def _cubic(c, t):  # type: ignore[no-untyped-def]
    return c[0] + t * (c[1] + t * (c[2] + t * c[3]))
