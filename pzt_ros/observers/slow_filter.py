"""The compiled Kalman filter of the hysteresis observer: slow disturbances, and which history the stage has had.

States: disturbance [m], its rate [m/s], CREEPS decaying displacements [m], zero of the charge meter [C/m^2], then one
coefficient [-] for each history. The measurement is base + disturbance + creeps + sum of coefficient times deviation of
that history, plus noise. The charge, where it is measured, is that of the polarization: its base + zero + sum of
coefficient times deviation, plus noise; the zero wanders, as that of an integrator does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pzt_ros.physics.signals import Array

CREEPS = 3
DISTURBANCE, RATE, CREEP, ZERO, HISTORY = 0, 1, 2, 2 + CREEPS, 3 + CREEPS

LAST, MEAN, SINCE, READING, REPEATED, BEFORE, REJECTED, MISSING, FROZEN, ORIGIN = range(10)
"""What is noted from sample to sample: time [s], mean innovation [m], time of the first of a row of rejected samples
[s], last reading [m], how often it was repeated, disturbance before it came [m]; samples rejected, missing, frozen;
then the base and all deviations when that reading came first [m]."""

_SURE = 2.0
"""Standard deviations by which the mean innovation has to differ from 0 before the disturbance is let go faster."""

_REPEATS = 3
"""Equal readings in a row that a sensor with a least step shows now and then."""

_MOVED = 4.0
"""Standard deviations of the noise by which the stage has to move under equal readings before they are taken for
frozen."""


class Tuning(NamedTuple):
    """Variances and times of the filter; see the parameters of the observer."""

    noise: float
    disturbance: float
    rate: float
    creep: float
    gate: float
    patience: float
    memory: float
    times: Array
    charge: float
    zero: float


@njit(cache=True, error_model="numpy")
def _forward(z, p, step, t, restless):  # type: ignore[no-untyped-def]
    """Mean and covariance one sample on."""
    n = z.size
    z[DISTURBANCE] += step * z[RATE]
    for j in range(n):
        p[DISTURBANCE, j] += step * p[RATE, j]
    for j in range(n):
        p[j, DISTURBANCE] += step * p[j, RATE]
    for c in range(CREEPS):
        left = math.exp(-step / t.times[c])
        k = CREEP + c
        z[k] *= left
        for j in range(n):
            p[k, j] *= left
        for j in range(n):
            p[j, k] *= left
        p[k, k] += t.creep * (1.0 - left * left)
    p[DISTURBANCE, DISTURBANCE] += step * (t.disturbance + restless)
    p[RATE, RATE] += step * t.rate
    p[ZERO, ZERO] += step * t.zero


@njit(cache=True, error_model="numpy")
def _row(h, deviation):  # type: ignore[no-untyped-def]
    h[DISTURBANCE], h[RATE] = 1.0, 0.0
    h[CREEP:ZERO] = 1.0
    h[ZERO] = 0.0
    h[HISTORY:] = deviation


@njit(cache=True, error_model="numpy")
def _charge_row(h, deviation):  # type: ignore[no-untyped-def]
    h[:HISTORY] = 0.0
    h[ZERO] = 1.0
    h[HISTORY:] = deviation


@njit(cache=True, error_model="numpy", fastmath=True)
def _spread(p, h):  # type: ignore[no-untyped-def]
    """Variance of a linear combination of the histories' coefficients."""
    total = 0.0
    for i in range(h.size):
        row, inner = p[HISTORY + i, HISTORY:], 0.0
        for j in range(h.size):
            inner += row[j] * h[j]
        total += h[i] * inner
    return max(total, 0.0)


@njit(cache=True, error_model="numpy", fastmath=True)
def _seen(p, h, ph):  # type: ignore[no-untyped-def]
    """Fill `ph` with p h; returns h p h, the variance that the states give to the reading."""
    variance = 0.0
    for i in range(h.size):
        row, inner = p[i], 0.0
        for j in range(h.size):
            inner += row[j] * h[j]
        ph[i] = inner
        variance += h[i] * inner
    return max(variance, 0.0)


@njit(cache=True, error_model="numpy", fastmath=True)
def _learn(z, p, ph, innovation, variance):  # type: ignore[no-untyped-def]
    """Mean and covariance with a reading that is that far from what was expected."""
    for i in range(z.size):
        gain, row = ph[i] / variance, p[i]
        z[i] += gain * innovation
        for j in range(z.size):
            row[j] -= gain * ph[j]


@njit(cache=True, error_model="numpy")
def _is_frozen(reading, base, deviation, z, notes, t):  # type: ignore[no-untyped-def]
    """Whether the stage has moved by now, as the histories have it, while the reading stayed the same to the bit.

    What the disturbance had learned of such readings by then is undone.
    """
    if reading != notes[READING]:
        notes[READING], notes[REPEATED], notes[BEFORE], notes[ORIGIN] = reading, 0.0, z[DISTURBANCE], base
        notes[ORIGIN + 1 :] = deviation
    notes[REPEATED] += 1.0
    if notes[REPEATED] <= _REPEATS:
        return False
    moved = base - notes[ORIGIN]
    for j in range(deviation.size):
        moved += (deviation[j] - notes[ORIGIN + 1 + j]) * z[HISTORY + j]
    if moved * moved <= _MOVED * _MOVED * t.noise:
        return False
    z[DISTURBANCE] = notes[BEFORE]
    return True


@njit(cache=True, error_model="numpy")
def _usable(frozen, reading, innovation, variance, now, notes, t):  # type: ignore[no-untyped-def]
    """Whether a reading is to be believed: there, not frozen, and no spike."""
    if not math.isfinite(reading):
        notes[MISSING] += 1.0
        return False
    if frozen:
        notes[FROZEN] += 1.0
        return False
    if innovation * innovation <= t.gate * t.gate * variance:
        notes[SINCE] = math.nan
        return True
    if math.isnan(notes[SINCE]):
        notes[SINCE] = now
    if now - notes[SINCE] < t.patience:
        notes[REJECTED] += 1.0
        return False
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def follow(z, p, notes, t, time, reading, charge, base, deviation, out):  # type: ignore[no-untyped-def]
    """Take a block of readings in; mean `z`, covariance `p` and `notes` move in place.

    Args:
        z, p: mean and covariance of the states [shapes (m,), (m, m)].
        notes: see LAST ... ORIGIN [shape (ORIGIN + 1 + m - HISTORY,)].
        t: tuning.
        time, reading: of the block [shape (n,)].
        charge: over the electrodes' area [C/m^2]; NaN where it is not measured [shape (n,)].
        base: of reading, polarization and phase fraction, as the mean of the histories has them [shape (3, n)].
        deviation: of each history from the base [shape (3, n, m - HISTORY)].
        out: is filled: reading without noise, polarization, phase fraction, their standard deviations, innovation,
            disturbance [shape (8, n)].
    """
    m = z.size
    h, ph = np.empty(m), np.empty(m)
    for k in range(time.size):
        step = max(time[k] - notes[LAST], 0.0)
        notes[LAST] = time[k]
        share = min(step / t.memory, 1.0)
        sure = _SURE * _SURE * 0.5 * share * t.noise
        _forward(z, p, step, t, max(notes[MEAN] * notes[MEAN] - sure, 0.0) / t.memory)
        _row(h, deviation[0, k])
        frozen = _is_frozen(reading[k], base[0, k], deviation[0, k], z, notes, t)
        variance = t.noise + _seen(p, h, ph)
        expected = base[0, k] + np.dot(h, z)
        innovation = reading[k] - expected if math.isfinite(reading[k]) else 0.0
        out[6, k] = innovation
        if _usable(frozen, reading[k], innovation, variance, time[k], notes, t):
            if not math.isnan(notes[SINCE]):  # too many to be spikes: the reading has jumped
                jump = innovation * innovation
                p[DISTURBANCE, DISTURBANCE] += jump
                variance += jump
                ph[DISTURBANCE] += jump
                notes[SINCE] = math.nan
            else:
                notes[MEAN] += share * (innovation * math.sqrt(t.noise / variance) - notes[MEAN])
            _learn(z, p, ph, innovation, variance)
            left = (variance - t.noise) * t.noise / variance
        else:
            left = variance - t.noise
        if math.isfinite(charge[k]):
            _weigh(z, p, h, ph, charge[k] - base[1, k], deviation[1, k], step, t)
            _row(h, deviation[0, k])
            left = _seen(p, h, ph)
        _tell(z, p, base, deviation, k, left, out)


@njit(cache=True, error_model="numpy")
def _weigh(z, p, h, ph, charge, deviation, step, t):  # type: ignore[no-untyped-def]
    """Take a charge in; where one is far from what is expected the zero is let go, until it is believed."""
    _charge_row(h, deviation)
    variance = t.charge + _seen(p, h, ph)
    miss = charge - np.dot(h, z)
    if miss * miss <= t.gate * t.gate * variance:
        _learn(z, p, ph, miss, variance)
    else:
        p[ZERO, ZERO] += miss * miss * min(step / t.patience, 1.0)


@njit(cache=True, error_model="numpy")
def _tell(z, p, base, deviation, k, variance, out):  # type: ignore[no-untyped-def]
    """Fill in one sample of the output."""
    for quantity in range(3):
        value = base[quantity, k]
        for j in range(deviation.shape[2]):
            value += deviation[quantity, k, j] * z[HISTORY + j]
        out[quantity, k] = value
    out[7, k] = z[DISTURBANCE]
    for c in range(CREEPS):
        out[7, k] += z[CREEP + c]
    out[0, k] += out[7, k]
    out[3, k] = math.sqrt(max(variance, 0.0))
    out[4, k] = math.sqrt(_spread(p, deviation[1, k]))
    out[5, k] = math.sqrt(_spread(p, deviation[2, k]))
