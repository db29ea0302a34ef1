"""How well a reference was followed: error statistics, per phase of a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pzt_ros.experiments.phases import Phase, Scan
from pzt_ros.physics.signals import Array
from pzt_ros.reference import DISPLACEMENT

FIRST_CONTROLLER = "open_loop"
"""In charge until a phase names another (`ControlLoop`)."""


@dataclass(frozen=True)
class TrackingError:
    """Statistics of reference minus displacement over a stretch of samples.

    Attributes:
        rms: root of the mean square [m].
        maximum: largest absolute value [m].
        mean: [m]; positive where the stage stays below the reference.
        stroke: the percentages refer to this [m].
        samples: how many had both a reference and a displacement.
    """

    rms: float
    maximum: float
    mean: float
    stroke: float
    samples: int

    @property
    def rms_percent(self) -> float:
        """Of the stroke [%]; NaN where the stroke is 0."""
        return 100.0 * self.rms / self.stroke if self.stroke > 0.0 else float("nan")

    @property
    def maximum_percent(self) -> float:
        """Of the stroke [%]; NaN where the stroke is 0."""
        return 100.0 * self.maximum / self.stroke if self.stroke > 0.0 else float("nan")


def tracking_error(reference: Array, displacement: Array, stroke: float) -> TrackingError | None:
    """The statistics of `reference - displacement` [m, shape (n,)]; None where no sample has both (NaN marks a gap)."""
    error = reference - displacement
    error = error[np.isfinite(error)]
    if error.size == 0:
        return None
    return TrackingError(
        rms=float(np.sqrt(np.mean(np.square(error)))),
        maximum=float(np.max(np.abs(error))),
        mean=float(np.mean(error)),
        stroke=stroke,
        samples=int(error.size),
    )


@dataclass(frozen=True)
class Stretch:
    """A phase of a scenario in the time of a run.

    Attributes:
        number: of the phase, from 1.
        phase: what was asked.
        controller: in charge; empty where the voltage itself was asked.
        begin, end: as planned [s].
        settled: from here on the error is counted [s]: after the first cycle of a scan of several, else `begin`.
    """

    number: int
    phase: Phase
    controller: str
    begin: float
    end: float
    settled: float

    def stroke(self, reference: Array) -> float:
        """Peak to peak of what was asked [m]; `reference` [m, shape (n,)] is needed for a phase other than a scan."""
        if isinstance(self.phase, Scan):
            return self.phase.peak_to_peak
        asked = reference[np.isfinite(reference)]
        return float(np.ptp(asked)) if asked.size else 0.0


def stretches(spans: Sequence[tuple[Phase, float, float]]) -> list[Stretch]:
    """The phases with their controllers, from `Experiment.spans()`."""
    controller, out = FIRST_CONTROLLER, []
    for number, (phase, begin, end) in enumerate(spans, start=1):
        controller = getattr(phase, "controller", "") or controller
        driven = controller if phase.quantity == DISPLACEMENT else ""
        settled = begin
        if isinstance(phase, Scan) and phase.cycles > 1.0:
            settled = begin + 1.0 / phase.frequency
        out.append(Stretch(number, phase, driven, begin, end, settled))
    return out


@dataclass(frozen=True)
class PhaseTracking:
    """How one phase was followed.

    Attributes:
        stretch: the phase.
        settled: error from `stretch.settled` on, by what it was taken against ("truth", "measurement").
        whole: error over the whole phase, likewise.
        done: share of the phase that was recorded [-].
    """

    stretch: Stretch
    settled: Mapping[str, TrackingError]
    whole: Mapping[str, TrackingError]
    done: float

    @property
    def judged(self) -> TrackingError:
        """The error to compare by: settled where there is such a part, against the first displacement of `track`."""
        return next(iter({**self.whole, **self.settled}.values()))


def track(stretch: Stretch, time: Array, reference: Array, displacements: Mapping[str, Array]) -> PhaseTracking | None:
    """The statistics of one phase; None where nothing of it was recorded.

    Args:
        stretch: a phase that asks for displacement.
        time: samples of the run, increasing [s, shape (n,)].
        reference: [m, shape (n,)]; NaN where none was given.
        displacements: by name, each [m, shape (n,)].
    """
    half = 0.5 * (time[1] - time[0]) if len(time) > 1 else 0.0  # time stamps are sums; never let rounding pick a sample
    first, settled, last = np.searchsorted(time, np.array([stretch.begin, stretch.settled, stretch.end]) - half)
    stroke = stretch.stroke(reference[first:last])
    planned = (stretch.end - stretch.begin) / (2.0 * half) if half else 1.0

    def errors(start: int) -> dict[str, TrackingError]:
        found = {key: tracking_error(reference[start:last], y[start:last], stroke) for key, y in displacements.items()}
        return {key: error for key, error in found.items() if error is not None}

    whole = errors(int(first))
    if not whole:
        return None
    done = max(error.samples for error in whole.values()) / planned
    return PhaseTracking(stretch, errors(int(settled)), whole, min(1.0, done))
