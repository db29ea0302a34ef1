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
CLEAR = 20.0
"""Power over the surroundings from which a frequency is a line: noise gets there once in a million frequencies."""
_NEARBY, _WIDTH = (
    5.0,
    2.0,
)  # surroundings of a given tone on both sides [Hz], frequencies of a spectrum that it takes up
_FEWEST_AROUND = 12  # frequencies of the surroundings on either side
_MOST = 8


def strongest(power: Array) -> tuple[int, float]:
    """Index of the frequency that stands out most from its surroundings, and by which factor."""
    ratio = power / np.maximum(_ndimage.median_filter(power, _AROUND, mode="reflect"), 1e-300)
    ratio[:_SLOWEST] = 0.0
    peak = int(np.argmax(ratio))
    return peak, float(ratio[peak])


def may_stand_out(time: Array, frequency: float) -> bool:
    """Whether samples are so many that a tone [Hz] has surroundings, and so close that it is one."""
    is_long = _NEARBY * float(np.ptp(time)) >= _FEWEST_AROUND
    return is_long and 2.0 * frequency * float(np.median(np.diff(time))) < 1.0


def standing_out(time: Array, values: Array, frequency: float) -> float:
    """Power of a tone [Hz] over the median of its surroundings, of samples that need not be even [each shape (n,)]."""
    length = float(np.ptp(time))
    count = round(length / float(np.median(np.diff(time))))
    even = np.interp(np.linspace(time[0], time[-1], count), time, values)
    power = np.abs(np.fft.rfft(np.hanning(count) * (even - even.mean()))) ** 2
    away = np.abs(np.arange(power.size) - frequency * length)  # in frequencies of the spectrum
    around = power[(away > _WIDTH) & (away <= _NEARBY * length)]
    return float(power[away <= _WIDTH].max() / max(float(np.median(around)), 1e-300))


def without_lines(time: Array, values: Array) -> tuple[Array, list[float]]:
    """A stretch of samples about a parabola without the tones that stand out, and their frequencies [Hz]."""
    left, found = about_parabola(time, values), []
    step = float(np.mean(np.diff(time)))
    for _ in range(_MOST if values.size >= 2 * FEWEST else 0):
        peak, ratio = strongest(np.abs(np.fft.rfft(np.hanning(values.size) * left)) ** 2)
        if ratio < CLEAR:
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
