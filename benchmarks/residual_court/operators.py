"""Hysteresis without domains: operators that other fields use, rate-independent, none of them an energy model."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CACHE = __name__.startswith("pzt_benchmarks.")  # on disk Numba knows a file by one name only


@njit(cache=_CACHE)
def play(drive: Array, radius: float, start: float = 0.0) -> Array:
    """A play of half width `radius` behind the drive, beginning in the middle of its slack."""
    out = np.empty_like(drive)
    y = start
    for k in range(drive.size):
        y = min(max(y, drive[k] - radius), drive[k] + radius)
        out[k] = y
    return out


@njit(cache=_CACHE)
def play_sum(drive: Array, radii: Array, weights: Array) -> Array:
    """Prandtl-Ishlinskii: a weighted sum of plays."""
    out = np.zeros_like(drive)
    y = np.zeros_like(radii)
    for k in range(drive.size):
        for i in range(radii.size):
            y[i] = min(max(y[i], drive[k] - radii[i]), drive[k] + radii[i])
            out[k] += weights[i] * y[i]
    return out


@njit(cache=_CACHE)
def bouc_wen(drive: Array, stiffness: float, beta: float, gamma: float) -> Array:
    """The hysteretic part z of a Bouc-Wen model of exponent 1: dz = A dv - (beta |dv| z + gamma dv |z|)."""
    out = np.zeros_like(drive)
    z = 0.0
    for k in range(1, drive.size):
        change = drive[k] - drive[k - 1]
        pieces = int(abs(change) * (beta + abs(gamma)) * 50.0) + 1
        dv = change / pieces
        for _ in range(pieces):  # Heun's rule on pieces over which z hardly moves
            first = stiffness * dv - beta * abs(dv) * z - gamma * dv * abs(z)
            guess = z + first
            second = stiffness * dv - beta * abs(dv) * guess - gamma * dv * abs(guess)
            z += 0.5 * (first + second)
        out[k] = z
    return out


@njit(cache=_CACHE)
def dahl(drive: Array, stiffness: float, coulomb: float) -> Array:
    """Dahl friction: dF/dx = stiffness (1 - F sgn(dx)/coulomb), exact between two samples."""
    out = np.zeros_like(drive)
    force = 0.0
    for k in range(1, drive.size):
        change = drive[k] - drive[k - 1]
        aim = coulomb if change >= 0.0 else -coulomb
        force = aim + (force - aim) * np.exp(-stiffness * abs(change) / coulomb)
        out[k] = force
    return out


@njit(cache=_CACHE)
def wedge_preisach(drive: Array, low: float, high: float) -> Array:
    """Rate-independent Preisach of uniform density between `low` and `high`, from 0, all down, to 1, all up.

    Everett's function of a uniform density is half a square, so a few remembered reversals are all there is to sum.
    """
    out = np.empty_like(drive)
    peaks, dips = np.empty(drive.size + 1), np.empty(drive.size + 1)
    count, last = 0, low
    for k in range(drive.size):
        level = min(max(drive[k], low), high)
        if level < last and (count == 0 or dips[count - 1] != last):  # it has just turned downwards
            peaks[count] = last
            count += 1
        if level < last:
            while count > 1 and dips[count - 2] >= level:
                count -= 1
            dips[count - 1] = level
        else:
            while count > 0 and peaks[count - 1] <= level:
                count -= 1
        base, area = low, 0.0
        for i in range(count):
            area += (peaks[i] - base) ** 2 - (peaks[i] - dips[i]) ** 2
            base = dips[i]
        out[k] = (area + (level - base) ** 2) / (high - low) ** 2
        last = level
    return out
