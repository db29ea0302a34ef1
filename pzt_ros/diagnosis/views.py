"""Residuals as a page shows them: over drive voltage, over the time since a hold began, by frequency band."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pzt_ros.diagnosis.data import FIT, SCORE, RunData
from pzt_ros.diagnosis.floor import holds
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.run import rms

_VOLTAGE_BINS = 48
_FEWEST_IN_BIN = 8
_PER_DECADE = 5
_REFERENCE = 5  # samples at the start of a hold that stand for its zero


@dataclass(frozen=True)
class OverVoltage:
    """Residuals over drive voltage, by the direction of the drive.

    Attributes:
        voltage, residual: samples [V], [m].
        direction: +1 where the drive rises, -1 where it falls, 0 where it rests.
        centres, rising, falling: bins [V] and means in them [m]; NaN where a bin has too few samples.
    """

    voltage: Array
    residual: Array
    direction: Array
    centres: Array
    rising: Array
    falling: Array


@dataclass(frozen=True)
class OverHold:
    """Residuals since the start of a hold, counted in the direction that the drive came from.

    Attributes:
        time: since the hold began [s, shape (m,)], a logarithmic grid.
        each: of every hold, less what it has in its first samples; NaN where it has none [m, shape (holds, m)].
        mean: over the holds, where at least half of them last so long; else NaN [m, shape (m,)].
        noise: standard deviation of `mean` that white noise alone makes [m, shape (m,)].
    """

    time: Array
    each: Array
    mean: Array
    noise: Array


@dataclass(frozen=True)
class ByBand:
    """Rms of residuals by frequency band.

    Attributes:
        edges: of the bands [Hz, shape (m + 1,)].
        rms: in each [m]; NaN where no run has such frequencies.
        noise: what white noise of the runs' floors has there [m].
    """

    edges: Array
    rms: Array
    noise: Array


def scored(runs: Sequence[RunData]) -> list[int]:
    """Indices of the test runs; of all runs where there are none."""
    return [number for number, run in enumerate(runs) if SCORE in run.picks] or list(range(len(runs)))


def centred(run: RunData, residual: Array) -> Array:
    """Without the mean over the part that was fitted, or over the whole."""
    picks = run.picks.get(FIT)
    left: Array = residual - float(np.mean(residual if picks is None else residual[picks]))
    return left


def over_voltage(runs: Sequence[RunData], residuals: Sequence[Array]) -> OverVoltage:
    """Of several runs together."""
    voltage = np.concatenate([run.record.voltage for run in runs])
    residual = np.concatenate([centred(run, r) for run, r in zip(runs, residuals, strict=True)])
    direction = np.concatenate([_direction(run.record.voltage) for run in runs])
    edges = np.linspace(float(voltage.min()), float(voltage.max()), _VOLTAGE_BINS + 1)
    rising, falling = (_means(voltage[direction == s], residual[direction == s], edges) for s in (1.0, -1.0))
    return OverVoltage(voltage, residual, direction, 0.5 * (edges[1:] + edges[:-1]), rising, falling)


def _direction(voltage: Array) -> Array:
    rate = np.gradient(voltage)
    still = np.abs(rate) <= 1e-6 * float(np.ptp(voltage))
    found: Array = np.where(still, 0.0, np.sign(rate))
    return found


def _means(places: Array, values: Array, edges: Array) -> Array:
    number = np.histogram(places, edges)[0]
    total = np.histogram(places, edges, weights=values)[0]
    return np.where(number >= _FEWEST_IN_BIN, total / np.maximum(number, 1), np.nan)


def over_hold(runs: Sequence[RunData], residuals: Sequence[Array]) -> OverHold | None:
    """Of all holds of several runs; None where the drive never rests after it has moved."""
    found = [hold for run, residual in zip(runs, residuals, strict=True) for hold in _held(run, residual)]
    if not found:
        return None
    edges = _logarithmic(min(float(time[0]) for time, _, _ in found), max(float(time[-1]) for time, _, _ in found))
    numbers = np.array([np.histogram(time, edges)[0] for time, _, _ in found])
    totals = np.array([np.histogram(time, edges, weights=values)[0] for time, values, _ in found])
    each = np.where(numbers > 0, totals / np.maximum(numbers, 1), np.nan)
    lasting = np.count_nonzero(numbers, axis=0)
    mean = np.where(2 * lasting >= len(found), np.nansum(each, axis=0) / np.maximum(lasting, 1), np.nan)
    noises = np.array([noise for _, _, noise in found])[:, None]
    squares = noises**2 * np.where(numbers > 0, 1.0 / np.maximum(numbers, 1) + 1.0 / _REFERENCE, 0.0)
    noise = np.sqrt(squares.sum(axis=0)) / np.maximum(lasting, 1)
    return OverHold(np.sqrt(edges[1:] * edges[:-1]), each, mean, noise)


def _held(run: RunData, residual: Array) -> list[tuple[Array, Array, float]]:
    """Of each hold: time since it began [s], residual along the drive's last step [m], the run's noise [m]."""
    voltage, time = run.record.voltage, run.record.time
    found = []
    for first, after in holds(voltage):
        if first > 0:
            sign = math.copysign(1.0, float(voltage[first] - voltage[first - 1]))
            zero = float(np.mean(residual[first : first + _REFERENCE]))
            found.append((time[first:after] - time[first - 1], sign * (residual[first:after] - zero), run.noise))
    return found


def by_band(runs: Sequence[RunData], residuals: Sequence[Array]) -> ByBand:
    """Of several runs together, each weighted by its duration; the squares of the bands add up to the variance."""
    steps = [float(np.median(np.diff(run.record.time))) for run in runs]
    durations = [float(run.record.time[-1] - run.record.time[0]) for run in runs]
    edges = _logarithmic(1.0 / max(durations), 0.5 / min(steps))
    power, noise, weight = (np.zeros(edges.size - 1) for _ in range(3))
    for run, residual, step, duration in zip(runs, residuals, steps, durations, strict=True):
        frequency, squares = _squares(run.record.time, residual, step)
        inside, number = np.histogram(frequency, edges, weights=squares)[0], np.histogram(frequency, edges)[0]
        known = number > 0
        power += duration * np.where(known, inside, 0.0)
        noise += duration * run.noise**2 * number / max(frequency.size, 1)
        weight += duration * known
    seen = weight > 0.0
    weight[~seen] = 1.0
    found = np.where(seen, np.sqrt(power / weight), np.nan), np.where(seen, np.sqrt(noise / weight), np.nan)
    return ByBand(edges, *found)


def _squares(time: Array, residual: Array, step: float) -> tuple[Array, Array]:
    """Frequencies above 0 [Hz] and the mean square at each [m^2], after even resampling."""
    even = np.arange(time[0], time[-1] + 0.5 * step, step)
    values = np.interp(even, time, residual)
    spectrum = np.abs(np.fft.rfft(values - values.mean())) ** 2 * 2.0 / values.size**2
    if values.size % 2 == 0:
        spectrum[-1] *= 0.5
    frequency: Any = np.fft.rfftfreq(values.size, step)
    return frequency[1:], spectrum[1:]


def _logarithmic(low: float, high: float) -> Array:
    """Edges of bands from a little below `low` to a little above `high`."""
    count = max(2, math.ceil(_PER_DECADE * math.log10(high / low)))
    return np.geomspace(0.999 * low, 1.001 * high, count + 1)


def picked(runs: Sequence[RunData], residuals: Sequence[Array], part: str) -> list[Array]:
    """Residuals of one part of every run that has it [m]."""
    return [r[run.picks[part]] for r, run in zip(residuals, runs, strict=True) if part in run.picks]


def share_of_span(runs: Sequence[RunData], residuals: Sequence[Array], part: str) -> float:
    """Rms over the run's peak to peak, on one part, over all runs that have it [-]."""
    shares = [
        rms(residual[run.picks[part]]) / float(np.ptp(run.record.displacement))
        for run, residual in zip(runs, residuals, strict=True)
        if part in run.picks
    ]
    return rms(np.array(shares)) if shares else math.nan


Places = NDArray[np.intp]


def evenly(count: int, most: int) -> Places:
    """At most so many of `count` places, evenly chosen."""
    return np.arange(0, count, max(1, -(-count // most)))
