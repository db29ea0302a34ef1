"""Plays with a shape function each: the compiled loops of the classical Preisach model.

A relay of coercive field r and interaction field e is up exactly where the play of half width r has come beyond e. So
the relays of one r are one number, the play y, and a function of it, the density over e summed up to y (Krejci;
Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, 2.4). The density over e is linear between lines h
apart and falls to 0 one h beyond the outermost, so the function is exact; only r is cut into narrow classes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pzt_ros.physics.bracketing import NEWTON, narrowed
from pzt_ros.physics.signals import Array

TIME, VOLTAGE, SLOPE, HEAD = 0, 1, 2, 3
"""State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], every play [V/m]."""

_NO_SUCH_FIELD = 1e9  # [V/m]
_MAX_TRIALS = 200


class Plays(NamedTuple):
    """What the compiled loops need.

    Attributes:
        radii: half width of each play, ascending [V/m, shape (n,)].
        weight: of each play at each line of interaction field, 0 at the first and the last [C/m^2, shape (n, m)].
        below: sum of the weight below each line [C/m^2, shape (n, m)].
        low, step: first line, and distance of the lines [V/m].
        susceptibility: of what does not switch [C/(V m)].
        offset: of what never switches [C/m^2].
        layer_thickness: [m].
    """

    radii: Array
    weight: Array
    below: Array
    low: float
    step: float
    susceptibility: float
    offset: float
    layer_thickness: float


class Classes(NamedTuple):
    """Where the plays lie in the coarse lines of coercive field.

    Attributes:
        line: number of the coarse line below each [shape (n,)].
        share: how far it is on the way to the next, 0 to 1 [shape (n,)].
        sums: of the shares that belong to each coarse line [shape (lines,)].
    """

    line: NDArray[np.int64]
    share: Array
    sums: Array


@njit(cache=True, inline="always", error_model="numpy")
def _moved(y, field, radius):  # type: ignore[no-untyped-def]
    """The play after the field went straight to a value."""
    return min(max(y, field - radius), field + radius)


@njit(cache=True, error_model="numpy")
def _switched(state, plays, field):  # type: ignore[no-untyped-def]
    """What is up after the field went straight to a value [C/m^2], and how that changes with the field."""
    switched, slope, last = 0.0, 0.0, plays.weight.shape[1] - 1
    for i in range(plays.radii.size):
        before = state[HEAD + i]
        y = _moved(before, field, plays.radii[i])
        at = (y - plays.low) / plays.step
        if at >= last:
            switched += plays.below[i, last]
        elif at > 0.0:
            line = int(at)
            part, weight = at - line, plays.weight[i, line]
            climb = plays.weight[i, line + 1] - weight
            switched += plays.below[i, line] + part * (weight + 0.5 * part * climb)
            if y != before:
                slope += (weight + part * climb) / plays.step
    return switched, slope


@njit(cache=True, error_model="numpy")
def _polarization(switched, total, field, plays):  # type: ignore[no-untyped-def]
    return 2.0 * switched - total + plays.susceptibility * field + plays.offset


@njit(cache=True, error_model="numpy")
def _go(state, plays, time, field):  # type: ignore[no-untyped-def]
    """Move the state to the next sample."""
    for i in range(plays.radii.size):
        state[HEAD + i] = _moved(state[HEAD + i], field, plays.radii[i])
    state[TIME], state[VOLTAGE] = time, field * plays.layer_thickness


@njit(cache=True, error_model="numpy")
def _is_usable(time, field, state):  # type: ignore[no-untyped-def]
    return time - state[TIME] >= 0.0 and math.isfinite(time) and abs(field) <= _NO_SUCH_FIELD


@njit(cache=True, error_model="numpy", nogil=True)
def run(state, plays, time, voltage, polarization, phase_fraction):  # type: ignore[no-untyped-def]
    """Step through a block; `state` moves in place, the last two arrays are filled.

    Returns the index of the first sample that cannot be used (time runs back, not finite, absurd field), else -1.
    """
    total = plays.below[:, -1].sum()
    for k in range(time.size):
        field = voltage[k] / plays.layer_thickness
        if not _is_usable(time[k], field, state):
            return k
        _go(state, plays, time[k], field)
        switched, _ = _switched(state, plays, field)
        phase_fraction[k] = switched / total
        polarization[k] = _polarization(switched, total, field, plays)
    return -1


@njit(cache=True, error_model="numpy", nogil=True)
def run_columns(state, plays, time, voltage, classes, columns):  # type: ignore[no-untyped-def]
    """Step through a block, and say what is up of the hat at each pair of coarse lines.

    Args:
        state, time, voltage: as in `run`.
        plays: of which only radii and lines count.
        classes: of the plays.
        columns: filled with shares of 1 [shape (samples, coarse lines, lines of interaction field without the outer)].

    Returns:
        As `run`.
    """
    lines = columns.shape[2]
    full = np.empty((columns.shape[1], lines + 2))
    for k in range(time.size):
        field = voltage[k] / plays.layer_thickness
        if not _is_usable(time[k], field, state):
            return k
        _go(state, plays, time[k], field)
        full[:] = 0.0
        columns[k] = 0.0
        for i in range(plays.radii.size):
            at = (state[HEAD + i] - plays.low) / plays.step
            if at <= 0.0:
                continue
            line = min(int(at), lines + 1)
            part = min(at - line, 1.0)
            coarse, share = classes.line[i], classes.share[i]
            for c, s in ((coarse, 1.0 - share), (coarse + 1, share)):
                full[c, line] += s  # all hats below this line are up
                if 1 <= line <= lines:
                    columns[k, c, line - 1] += s * (1.0 - 0.5 * (1.0 - part) ** 2)
                if line < lines:
                    columns[k, c, line] += s * 0.5 * part**2
        for c in range(columns.shape[1]):
            above = full[c, lines + 1]
            for j in range(lines - 1, -1, -1):
                columns[k, c, j] = (columns[k, c, j] + above) / classes.sums[c]
                above += full[c, j + 1]
    return -1


@njit(cache=True, error_model="numpy")
def run_inverse(state, plays, time, target, voltage, phase_fraction, limit, tolerance):  # type: ignore[no-untyped-def]
    """Find the voltage at the end of each sample that gives the target polarization [C/m^2]; otherwise as `run`.

    P never falls with the field. A root is searched within +-limit [V]; where there is none, the limit is the answer.
    The bracket is halved from the trial NEWTON on.
    """
    total, widest = plays.below[:, -1].sum(), limit / plays.layer_thickness
    for k in range(time.size):
        if not (time[k] - state[TIME] >= 0.0 and math.isfinite(time[k])):
            return k
        field = state[VOLTAGE] / plays.layer_thickness
        low, high = -widest, widest
        switched, slope = _switched(state, plays, field)
        for count in range(_MAX_TRIALS if math.isfinite(target[k]) else 0):
            miss = _polarization(switched, total, field, plays) - target[k]
            if abs(miss) <= tolerance or high - low <= 1e-15 * widest:
                break
            low, high, field = narrowed(low, high, field, miss, 2.0 * slope + plays.susceptibility, count >= NEWTON)
            switched, slope = _switched(state, plays, field)
        state[SLOPE] = (2.0 * slope + plays.susceptibility) / plays.layer_thickness
        _go(state, plays, time[k], field)
        voltage[k], phase_fraction[k] = state[VOLTAGE], switched / total
    return -1
