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

from pzt_ros.physics.front_kinetics import HIGH, LOW, SHARE, merge, move, overlaps, profile, relative_attempts
from pzt_ros.physics.signals import Array

TURNS = 512
"""Turning points that fit into the memory: 256 pairs."""

TIME, VOLTAGE, STEEPNESS, FRACTION, DIRECTION, DEPTH, LEADER, LEAD, FOLLOWER, FOLLOWER_LEAD, HEAD = range(11)
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], x+ [-], +1 or -1, number of
turning points; leader and follower with their leads [units of d], on which follow TURNS positions, leads and sums."""

STATE_SIZE = HEAD + 3 * TURNS

_LEFT_BEHIND = 2.0  # [d]; a leader that the field has fallen below by less is still switching
_CLOSED = 1.2  # relative attempts of a turning point at a leader that has reached it
_MAX_SUBSTEPS = 100_000
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]; a hundred times what breaks a ceramic
_FAR = 1e6  # [d]; where the turning point before the virgin state lies


class Fronts(NamedTuple):
    """The material as the loops want it.

    Attributes:
        profile: see front_kinetics.profile_table.
        cells: see front_tables.Everett, as are the next four but in units of d.
        spacing_c, spacing_m, reach: [d].
        initial: [-].
        width: d [V/m].
        attempt_rate: 1/tau [1/s].
        susceptibility: 1/E_1 [C/(V m)].
        domain_polarization: P_T [C/m^2].
        bias: polarization that the interaction fields alone would make [C/m^2].
        layer_thickness: [m].
        dead_band: [d].
        field_step: longest substep [d].
    """

    profile: Array
    cells: Array
    spacing_c: float
    spacing_m: float
    reach: float
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


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _triangle(fr, s, u, l):  # type: ignore[no-untyped-def]
    """T(u, l) of hard fronts [-]."""
    u = min(max(u, -fr.reach), fr.reach)
    l = min(max(l, -fr.reach), fr.reach)  # noqa: E741
    if u <= l:
        return 0.0
    f = fr.cells
    p = (u - l) * fr.per_c
    q = f.shape[1] // 2 - s * (u + l) * fr.per_m
    i, j = int(p), int(q)
    a0, a1, a2, a3 = _weights(p - i)
    b0, b1, b2, b3 = _weights(q - j)
    return (
        b0 * (a0 * f[i, j, 0] + a1 * f[i + 1, j, 0] + a2 * f[i, j, 1] + a3 * f[i + 1, j, 1])
        + b1 * (a0 * f[i, j + 1, 0] + a1 * f[i + 1, j + 1, 0] + a2 * f[i, j + 1, 1] + a3 * f[i + 1, j + 1, 1])
        + b2 * (a0 * f[i, j, 2] + a1 * f[i + 1, j, 2] + a2 * f[i, j, 3] + a3 * f[i + 1, j, 3])
        + b3 * (a0 * f[i, j + 1, 2] + a1 * f[i + 1, j + 1, 2] + a2 * f[i, j + 1, 3] + a3 * f[i + 1, j + 1, 3])
    )


@njit(cache=True, error_model="numpy")
def _virgin(fr, s, u, l):  # type: ignore[no-untyped-def]
    """Turned x - initial of hard fronts in a virgin specimen: first down to l, then up to u."""
    if u > -l:
        total, difference = _halves(fr, s, u, 0.0)
        return 0.5 * (total + difference)
    total, difference = _halves(fr, s, -l, 0.0)
    return _triangle(fr, s, u, l) - 0.5 * (total - difference)


@njit(cache=True, error_model="numpy")
def _first_turn(fr, s, u, lead, l, lead_l):  # type: ignore[no-untyped-def]
    """The same of fronts with profiles."""
    w, v = profile(fr.profile, lead, SHARE), profile(fr.profile, lead_l, SHARE)
    u1, u2 = u + profile(fr.profile, lead, LOW), u + profile(fr.profile, lead, HIGH)
    l1, l2 = l - profile(fr.profile, lead_l, LOW), l - profile(fr.profile, lead_l, HIGH)
    first = v * _virgin(fr, s, u1, l1) + (1.0 - v) * _virgin(fr, s, u1, l2)
    second = v * _virgin(fr, s, u2, l1) + (1.0 - v) * _virgin(fr, s, u2, l2)
    return w * first + (1.0 - w) * second


@njit(cache=True, error_model="numpy")
def _leg(fr, k, s, u, lead, l, lead_l):  # type: ignore[no-untyped-def]
    """What the way from turning point k - 1 (at l) to k (at u) adds to x, in turned positions."""
    if k == 1:
        return s * _first_turn(fr, s, u, lead, l, lead_l)
    return s * _everett(fr, s, u, lead, l, lead_l)


@njit(cache=True, error_model="numpy")
def _history(state, fr, u, lead, keep):  # type: ignore[no-untyped-def]
    """Sum of all legs up to the last turning point, as the leader (at turned u) has changed them.

    Turning points in the leader's direction that lie within its profile merge with it; `keep` writes that down.
    """
    n, s = int(state[DEPTH]), state[DIRECTION]
    turn, turn_lead = state[HEAD : HEAD + TURNS], state[HEAD + TURNS : HEAD + 2 * TURNS]
    total = state[HEAD + 2 * TURNS : STATE_SIZE]
    first = n
    while first >= 2 and overlaps(u, lead, s * turn[first - 2]):
        first -= 2
    if first == n:
        return total[n - 1]
    before, before_lead = turn[max(first - 1, 0)], turn_lead[max(first - 1, 0)]
    x = total[first - 1] if first > 0 else 0.0
    for k in range(first, n):
        at, at_lead, side = turn[k], turn_lead[k], -s
        if (k - first) % 2 == 0:
            side = s
            at, at_lead = merge(s * at, at_lead, u, lead)
            at *= s
        if k > 0:
            x += _leg(fr, k, side, side * at, at_lead, side * before, before_lead)
        before, before_lead = at, at_lead
        if keep:
            turn[k], turn_lead[k], total[k] = at, at_lead, x
    return x


@njit(cache=True, error_model="numpy")
def _fraction(state, fr, field):  # type: ignore[no-untyped-def]
    """x+ [-] at a turned field [d]."""
    n, s = int(state[DEPTH]), state[DIRECTION]
    u, lead, l, lead_l = state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD]
    last, last_lead = s * state[HEAD + n - 1], state[HEAD + TURNS + n - 1]
    x = fr.initial + _history(state, fr, u, lead, False)
    x += _leg(fr, n, s, u, lead, last, last_lead)
    mirror = 2.0 * field - l
    down = _equilibrium(fr, s, mirror, lead_l, field)
    if mirror != u:  # not slaved
        down += _everett(fr, s, u, lead, l, lead_l) - _everett(fr, s, mirror, lead_l, l, lead_l)
    return x - s * down


@njit(cache=True, error_model="numpy")
def _close(state, fr, field):  # type: ignore[no-untyped-def]
    """Wipe out the turning points that the leader has passed, moving it so that x+ stays."""
    while state[DEPTH] >= 2:
        n, s = int(state[DEPTH]), state[DIRECTION]
        u, lead = state[LEADER], state[LEAD]
        passed, passed_lead = s * state[HEAD + n - 2], state[HEAD + TURNS + n - 2]
        if passed > u + 1.0 or (passed > u and relative_attempts(passed, passed_lead, u) > _CLOSED):
            return
        slaved = state[FOLLOWER] == 2.0 * field - u
        x = s * _fraction(state, fr, field)
        top, top_lead = merge(passed, passed_lead, u, lead)
        if n == 2:  # in a virgin specimen the other side's extreme goes on to count
            for column in range(2):
                state[HEAD + column * TURNS] = state[HEAD + column * TURNS + 1]
            state[HEAD + 2 * TURNS] = 0.0
        state[DEPTH] = max(n - 2, 1)
        low, high, share = 0.0, 1.0, 0.0
        for trial in range(50):
            _place(state, u + share * (top - u), lead + share * (top_lead - lead), slaved, field)
            miss = s * _fraction(state, fr, field) - x
            if trial == 0:
                low_miss = miss
            elif trial == 1:
                high_miss = miss
            if abs(miss) < 1e-15 or high - low < 1e-13:
                break
            if trial == 0:
                share = 1.0
                continue
            if trial > 1:
                if miss < 0.0:
                    low, low_miss = share, miss
                    high_miss *= 0.5  # Illinois: the other end must not get stuck
                else:
                    high, high_miss = share, miss
                    low_miss *= 0.5
            if not low_miss < 0.0 < high_miss:
                break
            share = low + (high - low) * low_miss / (low_miss - high_miss)


@njit(cache=True, error_model="numpy")
def _place(state, u, lead, slaved, field):  # type: ignore[no-untyped-def]
    state[LEADER], state[LEAD] = u, lead
    if slaved:
        state[FOLLOWER], state[FOLLOWER_LEAD] = 2.0 * field - u, lead


@njit(cache=True, error_model="numpy")
def _turn(state, fr, field):  # type: ignore[no-untyped-def]
    """The leader becomes a turning point and the follower leads; drops the innermost pair when the memory is full."""
    s = state[DIRECTION]
    u, lead = state[LEADER], state[LEAD]
    total = _history(state, fr, u, lead, True)
    n = int(state[DEPTH])
    if n == TURNS:
        n -= 2
        total = state[HEAD + 2 * TURNS + n - 1]
    total += _leg(fr, n, s, u, lead, s * state[HEAD + n - 1], state[HEAD + TURNS + n - 1])
    state[HEAD + n], state[HEAD + TURNS + n], state[HEAD + 2 * TURNS + n] = s * u, lead, total
    state[DEPTH] = n + 1
    state[DIRECTION] = -s
    leader, lead = -state[FOLLOWER], state[FOLLOWER_LEAD]
    _place(state, leader, lead, True, -field)


@njit(cache=True, error_model="numpy")
def _substep(state, fr, start, end, duration):  # type: ignore[no-untyped-def]
    """Both fronts through a linear piece of field [d] in a time [tau]."""
    s = state[DIRECTION]
    y0, y1 = s * start, s * end
    u, lead = state[LEADER], state[LEAD]
    follower, follower_lead = state[FOLLOWER], state[FOLLOWER_LEAD]
    slaved = follower == 2.0 * y0 - u
    if duration > 0.0:
        u, lead = move(fr.profile, u, lead, y0, y1, duration)
        if not (slaved and y1 >= y0):  # else the mirror image stays ahead of the follower
            moved, follower_lead = move(fr.profile, -follower, follower_lead, -y0, -y1, duration)
            follower = -moved
    mirror = 2.0 * y1 - u
    if follower <= mirror or (slaved and y1 >= y0):
        follower, follower_lead = mirror, lead
    state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD] = u, lead, follower, follower_lead
    _close(state, fr, y1)
    if follower > mirror + fr.dead_band and u - y1 > _LEFT_BEHIND:
        _turn(state, fr, y1)
        _close(state, fr, -y1)


@njit(cache=True, error_model="numpy")
def _advance(state, fr, end, duration):  # type: ignore[no-untyped-def]
    """Take the state through a linear ramp to the field `end` [V/m] in `duration` [s]; returns x+."""
    first = state[VOLTAGE] / fr.layer_thickness / fr.width
    last = end / fr.width
    time = duration * fr.attempt_rate
    count = int(min(max(math.ceil(abs(last - first) / fr.field_step), 1.0), _MAX_SUBSTEPS))
    if time == 0.0:
        count = 1
    before = first
    for k in range(1, count + 1):
        after = last if k == count else first + (last - first) * k / count
        _substep(state, fr, before, after, time / count)
        before = after
    x = min(max(_fraction(state, fr, state[DIRECTION] * last), 0.0), 1.0)
    state[FRACTION] = x
    return x


@njit(cache=True, error_model="numpy")
def virgin(state, fr):  # type: ignore[no-untyped-def]
    """Fill in the state of a virgin specimen at zero field."""
    state[DIRECTION], state[DEPTH], state[FRACTION] = 1.0, 1.0, fr.initial
    state[HEAD] = _FAR


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
