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

from pzt_ros.physics.compiling import OUTER
from pzt_ros.physics.front_glide import COLUMNS, TRACE, advance, glide, left_behind
from pzt_ros.physics.front_kinetics import inner, unfolded
from pzt_ros.physics.front_memory import (
    DIRECTION,
    FAR,
    FOLLOWER,
    FOLLOWER_LEAD,
    FRACTION,
    HEAD,
    LEAD,
    LEADER,
    SLAVED,
    STEEPNESS,
    TIME,
    VOLTAGE,
    close,
    copy,
    fraction,
    turn,
)

_MAX_SUBSTEPS = 100_000
_MAX_TRIALS = 80
_NO_SUCH_FIELD = 1e9  # [V/m]; a hundred times what breaks a ceramic


@unfolded
def _substep(state, fr, start, end, duration):  # type: ignore[no-untyped-def]
    """Both fronts through a linear piece of field [d] in a time [tau]."""
    s = state[DIRECTION]
    y0, y1 = s * start, s * end
    fronts = state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD], state[SLAVED] > 0.0
    u, lead, l, lead_l, slaved = advance(fr.table, fronts, y0, y1, duration)
    state[LEADER], state[LEAD], state[FOLLOWER], state[FOLLOWER_LEAD] = u, lead, l, lead_l
    state[SLAVED] = 1.0 if slaved else 0.0
    turned = False
    while True:  # twice at most, with one call of `close`: each costs half a second to compile
        close(state, fr, y1)
        if turned or not left_behind(fr, u, l, y1):
            break
        turn(state, fr, y1)
        turned, y1 = True, -y1


@inner
def _detour(state, fr, time, voltage):  # type: ignore[no-untyped-def]
    """Go on to a sample in substeps, whatever happens on the way; returns x+."""
    first, last = state[VOLTAGE] * fr.per_volt, voltage * fr.per_volt
    duration = (time - state[TIME]) * fr.attempt_rate
    if state[DIRECTION] == 0.0:  # virgin: the first move decides who leads
        state[DIRECTION] = 1.0 if last >= first else -1.0
        state[HEAD] = state[DIRECTION] * FAR
    count = int(min(max(math.ceil(abs(last - first) / fr.field_step), 1.0), _MAX_SUBSTEPS))
    if duration == 0.0:
        count = 1
    before = first
    for k in range(1, count + 1):
        after = last if k == count else first + (last - first) * k / count
        _substep(state, fr, before, after, duration / count)
        before = after
    x = min(max(fraction(state, fr, state[DIRECTION] * last), 0.0), 1.0)
    state[FRACTION], state[TIME], state[VOLTAGE] = x, time, voltage
    return x


@inner
def _polarization(x, voltage, fr):  # type: ignore[no-untyped-def]
    return voltage * fr.least_slope + fr.bias + (2.0 * x - 1.0) * fr.domain_polarization


@njit(**OUTER, error_model="numpy", nogil=True)
def run(state, fr, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    highest = _NO_SUCH_FIELD * fr.layer_thickness
    trace = np.empty((TRACE, COLUMNS))
    k, bad = np.int64(0), np.int64(-1)
    while k < time.size:
        begun = k
        k = glide(state, fr, k, time, voltage, phase_fraction, trace)
        if k == begun:
            if not (time[k] >= state[TIME] and math.isfinite(time[k]) and abs(voltage[k]) <= highest):
                bad = k
                break
            phase_fraction[k] = _detour(state, fr, time[k], voltage[k])
            k += 1
    for j in range(k):
        polarization[j] = _polarization(phase_fraction[j], voltage[j], fr)
    return bad


@njit(**OUTER, error_model="numpy", nogil=True)
def run_inverse(state, fr, time, target, voltage, phase_fraction, limit, tolerance):  # type: ignore[no-untyped-def]
    """Find the voltage at the end of each sample that gives the target polarization [C/m^2]; otherwise as `run`.

    P rises with the voltage, at least as steeply as without switching, and a root lies within +-limit [V] or beyond:
    then the limit is the answer. The first trial continues with the last sample's slope, then secants; bisection where
    they leave the bracket or do not halve it in three.
    """
    trial_state = state.copy()
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
            copy(state, trial_state)
            x = _detour(trial_state, fr, time[k], v)
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
        copy(trial_state, state)
        voltage[k] = v
        phase_fraction[k] = state[FRACTION]
    return -1
