"""What is left after the repair: how large, when, and in which band, so that a person can go and look."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal as scipy_signal

from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.floor import quiet_stretches, sampling_class
from pzt_ros.diagnosis.gaps import lost_turns
from pzt_ros.diagnosis.lines import FEWEST, strongest
from pzt_ros.diagnosis.views import centred
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.noise import spread_of
from pzt_ros.sysid.spikes import not_counted

_signal: Any = scipy_signal  # SciPy carries no types

_LINE = 12.0  # a spectral line stands out by this factor over the median of its surroundings
_PIECE = 4096  # samples of a spectrum
_WINDOWS = 24
_MEAN_TIME = 0.05  # [s], slow remains show in means over this
_FEWEST_MEANS = 4  # of a hold: a third difference takes as many
_LEAST_SLOW = 0.2  # of the noise: a model is as near to a stage as that, and no nearer


@dataclass(frozen=True)
class Remains:
    """The misfit that no named effect explains.

    Attributes:
        rms: over all parts [m].
        times_noise: rms over the noise floor.
        slow: rms of means over 50 ms, in units of what the noise leaves of them.
        present: whether it, or readings that stand alone, are more than the noise.
        what_is_seen: in words.
        only_spikes: whether it is only those readings.
    """

    rms: float
    times_noise: float
    slow: float
    present: bool
    what_is_seen: str
    only_spikes: bool = False


def remains_of(runs: Sequence[RunData], residuals: Sequence[Array], floor: float, slow_floor: float) -> Remains:
    """Describe residuals [m], one for each run.

    Args:
        runs, residuals: of the same length.
        floor: rms over noise from which something is left.
        slow_floor: the same for slow means.
    """
    left = [np.where(run.clear, centred(run, r), 0.0) for run, r in zip(runs, residuals, strict=True)]
    squares, counted = [float(r @ r) for r in left], [max(int(np.count_nonzero(run.clear)), 1) for run in runs]
    rms = math.sqrt(sum(squares) / sum(counted))
    ratios = [math.sqrt(ssr / n) / run.noise for ssr, n, run in zip(squares, counted, runs, strict=True)]
    slow = [_slow_ratio(run, r, colour) for run, r, colour in zip(runs, left, _colours(runs), strict=True)]
    times = math.sqrt(float(np.mean(np.square(ratios))))
    seen = [_described(runs, left, ratios)] if max(ratios) > floor or max(slow) > slow_floor else []
    spiky = [run for run, ratio in zip(runs, ratios, strict=True) if math.hypot(ratio, _of_spikes(run)) > floor]
    alone = _alone([run for run in spiky if run.spikes])
    beside = [f"beside them {times:.2f} x the noise floor is left"] if alone and not seen else []
    what_is_seen = "; ".join([*seen, *alone, *beside])
    return Remains(rms, times, max(slow), bool(what_is_seen), what_is_seen, bool(beside))


def _of_spikes(run: RunData) -> float:
    """What readings that stand alone add to the rms, over the noise."""
    spikes = run.spikes.get("displacement_m")
    return float(np.linalg.norm(spikes.heights)) / (run.noise * math.sqrt(len(run.record))) if spikes else 0.0


def _alone(runs: Sequence[RunData]) -> list[str]:
    """How many readings stand alone, and which is farthest off."""
    found = [(run, run.spikes["displacement_m"]) for run in runs if "displacement_m" in run.spikes]
    if not found:
        return []
    count = sum(spikes.places.size for _, spikes in found)
    run, (place, height) = max(((run, spikes.farthest) for run, spikes in found), key=lambda each: each[1][1])
    where = f"{Path(run.record.name).name} at {run.record.time[place]:.4g} s"
    return [f"{not_counted(count)}, the farthest {height * 1e9:.4g} nm off, in {where}"]


def _slow_ratio(run: RunData, residual: Array, colour: float) -> float:
    """See Remains.slow; 0 where it is too small to matter, however sure."""
    length = _mean_length(run)
    if residual.size < 8 * length or np.any(lost_turns(run.record)):  # a turn inside a minor loop stays
        return 0.0
    rms = float(np.sqrt(np.mean(_means(residual, length) ** 2)))
    return rms * math.sqrt(length) / (colour * run.noise) if rms > _LEAST_SLOW * run.noise else 0.0


def _mean_length(run: RunData) -> int:
    """Samples of a mean."""
    return max(round(_MEAN_TIME / float(np.median(np.diff(run.record.time)))), 4)


def _colours(runs: Sequence[RunData]) -> list[float]:
    """By how much means of the noise of each run are larger than those of white noise, as holds show.

    Single holds tell it badly, so those of all runs at one rate are asked together. Where runs at a rate have none, the
    same sensor's noise is taken to be as slow as it is at the others.
    """
    rates, shown = [sampling_class(run.record) for run in runs], {}
    stretches = quiet_stretches([run.record for run in runs])
    for rate in set(rates):
        alike = [(run, held) for run, held, own in zip(runs, stretches, rates, strict=True) if own == rate]
        means = [_means(hold / run.noise, _mean_length(run)) for run, held in alike for hold in held]
        told = [mean for mean in means if mean.size >= _FEWEST_MEANS]
        if told:
            shown[rate] = max(spread_of(told) * math.sqrt(_mean_length(alike[0][0])), 1.0)
    return [shown.get(rate, max(shown.values(), default=1.0)) for rate in rates]


def _means(values: Array, length: int) -> Array:
    """Of pieces of so many samples; what does not fill one at the end is left out."""
    count = values.size // length
    means: Array = values[: count * length].reshape(count, length).mean(axis=1)
    return means


def _described(runs: Sequence[RunData], residuals: Sequence[Array], ratios: Sequence[float]) -> str:
    worst = int(np.argmax(ratios))
    run, residual = runs[worst], residuals[worst]
    parts = [
        f"largest in {Path(run.record.name).name}: {ratios[worst]:.2f} x noise",
        _when(run, residual),
        _band(run, residual),
        _line(run, residual),
        _goes_with(run, residual),
    ]
    return "; ".join(part for part in parts if part)


def _when(run: RunData, residual: Array) -> str:
    time = run.record.time
    pieces = np.array_split(np.arange(residual.size), min(_WINDOWS, residual.size // 8))
    levels = np.array([np.sqrt(np.mean(residual[piece] ** 2)) for piece in pieces])
    worst = int(np.argmax(levels))
    piece = pieces[worst]
    if levels[worst] < 1.5 * np.median(levels):
        return "all along the run"
    return (
        f"strongest from {time[piece[0]]:.4g} to {time[piece[-1]]:.4g} s ({levels[worst] * 1e9:.3g} nm rms,"
        f" {np.median(levels) * 1e9:.3g} nm in the middle of the run)"
    )


def _spectrum(run: RunData, residual: Array) -> tuple[Array, Array]:
    """Frequencies [Hz] and power density [m^2/Hz], evenly resampled."""
    time = run.record.time
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    values = np.interp(even, time, residual)
    pieces = max(1, round(2 * values.size / _PIECE) - 1)  # half overlapping, so that none of the run is left out
    length = 2 * values.size // (pieces + 1)
    frequency, power = _signal.welch(values, 1.0 / step, nperseg=length, detrend="linear")
    return frequency, power


def _band(run: RunData, residual: Array) -> str:
    frequency, power = _spectrum(run, residual)
    edges = [0.0, *np.geomspace(max(frequency[1], 1e-3), frequency[-1], 8)]
    white = run.noise**2 / frequency[-1]
    excess = np.maximum(power - white, 0.0)
    shares = [float(np.sum(excess[(frequency >= a) & (frequency <= b)])) for a, b in itertools.pairwise(edges)]
    total = sum(shares)
    if total <= 0.0:
        return ""
    worst = int(np.argmax(shares))
    return f"{shares[worst] / total:.0%} of it between {edges[worst]:.3g} and {edges[worst + 1]:.3g} Hz"


def _line(run: RunData, residual: Array) -> str:
    frequency, power = _spectrum(run, residual)
    if frequency.size < FEWEST:
        return ""
    peak, ratio = strongest(power)
    return f"a line at {frequency[peak]:.4g} Hz" if ratio > _LINE else ""


def _goes_with(run: RunData, residual: Array) -> str:
    """With which signal of the run its size goes."""
    record = run.record
    rate = np.gradient(record.voltage, record.time)
    signals = {
        "the voltage": record.voltage,
        "the square of the voltage": record.voltage**2,
        "the sign of the drive's rate": np.sign(rate),
        "the drive's rate": rate,
        "time": record.time,
    }
    if record.temperature is not None:
        signals["the temperature"] = record.temperature
    if record.neighbour is not None:
        signals["the neighbour's displacement"] = record.neighbour
    found = {name: _correlation(values, residual) for name, values in signals.items()}
    best = max(found, key=lambda name: abs(found[name]))
    return f"goes with {best} (correlation {found[best]:+.2f})" if abs(found[best]) > 0.3 else ""


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    size = math.sqrt(float(a @ a) * float(b @ b))
    return float(a @ b) / size if size > 0.0 else 0.0
