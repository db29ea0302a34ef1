"""Fewer samples of a run that say the same about its drive: for searches that need not be exact."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pzt_ros.physics.signals import Array

_STEP, _TOLERANCE = 0.02, 0.0005  # of the range of voltage
_FEWEST = 1500  # samples that are kept at least, holds too
_TOLERANCE_OF_POLARIZATION = 0.0002  # of its range
_STEP_OF_CHANGE, _TOLERANCE_OF_CHANGE = 0.1, 0.02  # of the range of how one drive differs from another


@njit(cache=True)
def _kept(time, voltage, step, gap, tolerance):  # type: ignore[no-untyped-def]
    kept = [0]
    anchor, lowest, highest = 0, -math.inf, math.inf
    k = 1
    while k < time.size:
        duration = time[k] - time[anchor]
        slope = (voltage[k] - voltage[anchor]) / duration
        bent = slope < lowest or slope > highest
        if k > anchor + 1 and (bent or abs(voltage[k] - voltage[anchor]) > step or duration > gap):
            anchor, lowest, highest = k - 1, -math.inf, math.inf
            kept.append(anchor)
            continue
        lowest = max(lowest, (voltage[k] - tolerance - voltage[anchor]) / duration)
        highest = min(highest, (voltage[k] + tolerance - voltage[anchor]) / duration)
        k += 1
    if kept[-1] < time.size - 1:
        kept.append(time.size - 1)
    return np.array(kept)


def kept_samples(time: Array, voltage: Array, step: float, gap: float, tolerance: float) -> NDArray[np.intp]:
    """Indices of samples whose straight connections stay within a tolerance of the drive (swinging door).

    Args:
        time, voltage: of the run [s, V].
        step: largest step of voltage between two of them, where the run has smaller ones [V].
        gap: longest time between two of them, likewise [s].
        tolerance: of the voltage between them [V].
    """
    kept: Any = _kept(time, voltage, step, gap, tolerance)
    return np.asarray(kept, dtype=np.intp)


def thinned(time: Array, voltage: Array) -> NDArray[np.intp]:
    """The samples that a search is made on [s, V]."""
    return _thinned(time, voltage, _STEP, _TOLERANCE)


def thinned_for_both(time: Array, voltage: Array, other: Array) -> NDArray[np.intp]:
    """The same, with as many more as it takes to say how another drive differs [s, V, V]."""
    kept, change = thinned(time, voltage), other - voltage
    between = np.interp(time, time[kept], change[kept])
    if np.max(np.abs(between - change)) <= _TOLERANCE_OF_CHANGE * np.ptp(change):
        return kept
    return np.union1d(kept, _thinned(time, change, _STEP_OF_CHANGE, _TOLERANCE_OF_CHANGE))


def telling_samples(time: Array, voltage: Array, step: float, polarization: Array) -> NDArray[np.intp]:
    """Samples between which drive and polarization go straight, and so does what a change of kinetics adds to it.

    Args:
        time, voltage, polarization: of the run [s, V, C/m^2].
        step: largest step of voltage between two of them, where the run has smaller ones [V].
    """
    span, gap = float(np.ptp(voltage)), float(time[-1] - time[0]) / _FEWEST
    driven = kept_samples(time, voltage, step, gap, _TOLERANCE * span)
    told = kept_samples(time, polarization, math.inf, gap, _TOLERANCE_OF_POLARIZATION * float(np.ptp(polarization)))
    return np.union1d(driven, told)


def _thinned(time: Array, signal: Array, step: float, tolerance: float) -> NDArray[np.intp]:
    """With a step and a tolerance in shares of the range."""
    span, duration = float(np.ptp(signal)), float(time[-1] - time[0])
    return kept_samples(time, signal, step * span, duration / _FEWEST, tolerance * span)
