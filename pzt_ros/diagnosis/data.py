"""What a diagnosis may look at, and for what: samples to fit, samples to choose by, samples to score with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from pzt_ros.diagnosis.gaps import lost_turns
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.change import Columns
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.records import Record
from pzt_ros.sysid.fading import fading_curves
from pzt_ros.sysid.run import begins_driven, drive_of, first_half
from pzt_ros.sysid.run_in import fades, running_in
from pzt_ros.sysid.spikes import Spikes

Picks = NDArray[np.intp]

FIT, SELECTION, SCORE = "fit", "selection", "score"

_MOST = 60_000  # samples of a part that count; of a longer one evenly chosen
_MOST_PIECES = 40  # of a course by chance: of a longer run slower ones, or memory would grow with its square


@dataclass(frozen=True)
class RunData:
    """A run, the part of it that counts, and what that part is for.

    Attributes:
        record: the whole run; models run over all of it.
        picks: samples of each part it has.
        noise: floor of its displacement [m].
        polarization_noise: what a misfit of the polarization is measured in [C/m^2]; 0 where it was not recorded.
        spikes: readings that stood alone in it, by column.
        wander: time over which its readings may wander by chance [s]; 0 where they do not, inf for a straight line.
        poled: whether it begins at rest where a drive had left it that nobody recorded.
        fades: whether it begins with what a link that relaxes remembers of a past that nobody recorded.
        since: first sample that no past reaches, where those before do not count.
    """

    record: Record
    picks: dict[str, Picks]
    noise: float
    polarization_noise: float = 0.0
    spikes: Mapping[str, Spikes] = field(default_factory=dict)
    wander: float = 0.0
    poled: bool = False
    fades: bool = False
    since: int = 0

    @cached_property
    def signals(self) -> Signals:
        """The drive as it enters the chain."""
        return drive_of(self.record)

    @cached_property
    def clear(self) -> NDArray[np.bool_]:
        """Samples that a model can know."""
        clear = ~(lost_turns(self.record) | running_in(self.record))
        for spikes in self.spikes.values():
            clear[spikes.places] = False
        clear[: self.since] = False
        return clear

    def counted_from(self, since: int) -> RunData:
        """The run without the samples before."""
        return replace(self, since=since, picks={part: picks[picks >= since] for part, picks in self.picks.items()})

    @property
    def uncut(self) -> RunData:
        """The run with all samples from its first one."""
        run = replace(self, since=0)
        picks = {part: _thin(run, 0, int(each[-1]) + 1) for part, each in self.picks.items() if part != SCORE}
        return replace(run, picks={**self.picks, **picks})

    @cached_property
    def begins_driven(self) -> bool:
        """Whether the record has a past."""
        return begins_driven(self.record)

    @property
    def has_polarization(self) -> bool:
        """Whether the polarization takes part."""
        return self.polarization_noise > 0.0

    def misfit(self, part: str, displacement: Array, polarization: Array) -> Array:
        """Measurement minus model in units of the noise, offsets taken out; displacement first, then polarization."""
        return np.concatenate(self._centred(part, self.record.displacement - displacement, self._left_of(polarization)))

    def change(self, part: str, displacement: Columns, polarization: Columns) -> Columns:
        """What changes of the model do to `misfit` [each of shape (n,), or (n, p) for p of them]."""
        return np.concatenate(self._centred(part, -displacement, -polarization if self.has_polarization else None))

    def _left_of(self, polarization: Array) -> Array | None:
        measured = self.record.polarization
        return measured - polarization if self.has_polarization and measured is not None else None

    def _centred(self, part: str, displacement: Columns, polarization: Columns | None) -> list[Columns]:
        picks = self.picks[part]
        found = [_about_zero(displacement[picks], self.noise)]
        if self.has_nuisances:
            slow = self._slow(part).astype(found[0].dtype, copy=False)
            found[0] -= slow @ (slow.T @ found[0])
        if polarization is not None:
            found.append(_about_zero(polarization[picks], self.polarization_noise))
        return found

    def wandered(self, residual: Array) -> Array:
        """What of a residual over the whole run is of no interest, its mean too [m, (n,)]; see `nuisances`."""
        slow = np.column_stack((np.ones(len(self.record)), self.nuisances(np.arange(len(self.record)))))
        course: Array = slow @ np.linalg.lstsq(slow[self.clear], residual[self.clear], rcond=None)[0]
        return course

    def _slow(self, part: str) -> Array:
        """An orthonormal basis of the nuisances at the samples of a part [shape (m, k)]."""
        if part not in self._bases:
            curves = self.nuisances(self.picks[part])
            self._bases[part] = np.linalg.qr(curves - curves.mean(axis=0))[0]
        return self._bases[part]

    @property
    def has_nuisances(self) -> bool:
        """Whether its readings hold more than an offset that is taken out of the misfit."""
        return self.wander > 0.0 or self.fades

    def nuisances(self, picks: Picks) -> Array:
        """Curves of no interest in these samples: what wanders by chance, and what dies out [shape (m, k)]."""
        time = self.record.time
        slow = slow_curves(time[picks], self.wander) if self.wander > 0.0 else np.zeros((picks.size, 0))
        return np.column_stack((slow, fading_curves(time, since=self.since)[picks])) if self.fades else slow

    @cached_property
    def _bases(self) -> dict[str, Array]:
        return {}


def seen_through(chain: Chain, runs: Sequence[RunData]) -> list[RunData]:
    """Runs as a chain sees them: what its links remember of a past that nobody recorded is no misfit of it."""
    told = [fades(chain, run.record, run.poled) for run in runs]
    return [run if run.fades == each else replace(run, fades=each) for run, each in zip(runs, told, strict=True)]


def slow_curves(time: Array, spacing: float) -> Array:
    """Smooth curves that bend over `spacing` seconds, less one that the mean stands for [shape (n, k)].

    Cubic B-splines, or a straight line where a run is shorter than that.
    """
    duration = float(time[-1] - time[0])
    if duration < spacing:
        return ((time - time[0]) / max(duration, 1e-300))[:, np.newaxis]
    pieces = min(round(duration / spacing), _MOST_PIECES)
    knots = np.linspace(time[0], time[-1], pieces + 1)
    clamped = np.concatenate((np.full(3, knots[0]), knots, np.full(3, knots[-1])))
    curves: Array = BSpline.design_matrix(time, clamped, 3).toarray()[:, 1:]
    return curves


def _about_zero(seen: Columns, unit: float) -> Columns:
    """A copy of one's own, in a unit and less its mean; in place, for there may be hundreds of columns."""
    seen /= unit
    seen -= seen.mean(axis=0, dtype=float).astype(seen.dtype)
    return seen


def highest_voltage(runs: Sequence[RunData]) -> float:
    """Of all runs, whatever its sign [V]."""
    return max(float(np.max(np.abs(run.record.voltage))) for run in runs)


def split(train: Sequence[RunData], test: Sequence[RunData]) -> list[RunData]:
    """All of the train runs is fitted; the first half of each test run chooses, its second half scores."""
    found = [replace(run, picks={FIT: _thin(run, 0, len(run.record))}) for run in train]
    for run in test:
        half = first_half(len(run.record))
        found.append(replace(run, picks={SELECTION: _thin(run, 0, half), SCORE: _thin(run, half, len(run.record))}))
    return found


def _thin(run: RunData, first: int, after: int) -> Picks:
    clear = first + np.flatnonzero(run.clear[first:after])
    return clear[:: max(1, -(-clear.size // _MOST))]
