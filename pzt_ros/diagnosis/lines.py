"""Lines of a spectrum: found by how far they stand out, and taken out of a stretch of samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import ndimage as scipy_ndimage
from scipy import optimize as scipy_optimize

from pzt_ros.physics.signals import Array

_ndimage: Any = scipy_ndimage  # SciPy carries no types
_optimize: Any = scipy_optimize

FEWEST = 48
"""Frequencies that a spectrum must have for lines to be looked for."""
_AROUND = 31  # frequencies whose median is the surroundings of one
_SLOWEST = 16  # the first frequencies have no surroundings on one side, and slow motion stands out there
_CLEAR = 20.0  # over the surroundings: noise gets there once in a million frequencies
_MOST = 8


def strongest(power: Array) -> tuple[int, float]:
    """Index of the frequency that stands out most from its surroundings, and by which factor."""
    ratio = power / np.maximum(_ndimage.median_filter(power, _AROUND, mode="reflect"), 1e-300)
    ratio[:_SLOWEST] = 0.0
    peak = int(np.argmax(ratio))
    return peak, float(ratio[peak])


def without_lines(time: Array, values: Array) -> tuple[Array, list[float]]:
    """A stretch of samples about a parabola without the tones that stand out, and their frequencies [Hz]."""
    left, found = about_parabola(time, values), []
    step = float(np.mean(np.diff(time)))
    for _ in range(_MOST if values.size >= 2 * FEWEST else 0):
        peak, ratio = strongest(np.abs(np.fft.rfft(np.hanning(values.size) * left)) ** 2)
        if ratio < _CLEAR:
            break
        bounds = np.array([peak - 1.0, peak + 1.0]) / (values.size * step)
        options = {"xatol": 1e-4 * float(np.ptp(bounds))}
        best = _optimize.minimize_scalar(
            lambda f, left=left: float(np.sum(_without(time, left, f) ** 2)), bounds=bounds, options=options
        )
        left = _without(time, left, float(best.x))
        found.append(float(best.x))
    return left, found


def about_parabola(time: Array, values: Array) -> Array:
    """What a parabola through the samples leaves."""
    u = (time - time.mean()) / max(float(np.ptp(time)), 1e-300)
    return _beside(np.column_stack((np.ones_like(u), u, u**2)), values)


def _without(time: Array, values: Array, frequency: float) -> Array:
    phase = 2.0 * math.pi * frequency * (time - time[0])
    columns = np.column_stack((np.sin(phase), np.cos(phase), np.ones_like(phase)))
    return _beside(columns, values)


def _beside(columns: Array, values: Array) -> Array:
    left: Array = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return left
