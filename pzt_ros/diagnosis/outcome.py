"""From fitted hypotheses to chains that predict, and to the figures that a report states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pzt_ros.diagnosis.data import FIT, SCORE, SELECTION, RunData
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.effects.effect import GoesOn
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.covariance import effective_samples, parameter_covariance
from pzt_ros.sysid.fading import fading_curves
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.result import SETTLE_TIME
from pzt_ros.sysid.run import Start, rms, usual_past
from pzt_ros.sysid.start import reading_beyond
from pzt_ros.sysid.start_notes import past_as_data, start_as_data

_NORMAL_95 = 1.96
_FEWEST_TO_SETTLE = 20  # samples
_MODEL_ERROR = 2e-5  # of the span: as near do two models of one ceramic come to each other (court, seeds 912 and 913)


@dataclass(frozen=True)
class Errors:
    """How far predictions of the whole runs are from the measurements.

    Attributes:
        train, test: rms [m] over all train and over all test runs, without samples that a past reaches.
        selection, score: of the halves of the test runs.
        nrmse: of the test runs over their peak to peak [-].
        interval: 95 % interval of `score` [m, m], given how the error remembers itself.
        residuals: of every run, measurement minus prediction [m].
    """

    train: float
    test: float
    selection: float
    score: float
    nrmse: float
    interval: tuple[float, float]
    residuals: tuple[Array, ...]


def model_of(hypothesis: Hypothesis, name: str, command: str) -> Chain:
    """The chain of a hypothesis with what it needs to start on these runs and on others."""
    staged, vector = hypothesis.staged, hypothesis.vector
    chain = _as_it_is_now(staged, vector)
    own = staged.ceramic.start.size
    starts = [staged.ceramic.start_of(vector[:own], number) for number in range(len(staged.runs))]
    entries = []
    known = [number for number in staged.fitted if not _settles(staged.runs[number])]
    outputs = staged.outputs(vector, known)
    for number, (displacement, _) in zip(known, outputs, strict=True):
        start = _start_of(staged, vector, number, displacement, starts[number])
        entries.append(start_as_data(start, staged.runs[number].record.sha256, staged.runs[number].record.name))
    per_run = sorted({each.parameter for each in staged.coordinates if each.run is not None})
    past = usual_past([starts[n] for n in staged.fitted], [staged.runs[n].begins_driven for n in staged.fitted])
    other: dict[str, Any] = {"settle_s": SETTLE_TIME, **past_as_data(past)}
    if any(staged.runs[number].poled for number in staged.fitted):
        other["driven_before"] = True  # states of relays say so without a reversal, and links that relax remember it
    if per_run:
        other["per_run"] = per_run
    if staged.given:
        other["goes_on"] = _going(staged, known)
    notes = {"description": f"{name}, fitted by pzt diagnose", "start": {"runs": entries, "other": other}}
    notes["fit"] = {"command": command, "parameters": estimates(hypothesis)}
    return replace(chain, name=f"{staged.chain.name}-{name}", notes=notes)


def _start_of(staged: Staged, vector: Array, number: int, displacement: Array, start: Start) -> Start:
    """The history of a fitted run with what else belongs to it: parameters of its own, offset, what dies out."""
    run = staged.runs[number]
    picks, left = run.picks[FIT], run.record.displacement - displacement
    fading = fading_curves(run.record.time)[picks] if run.fades else np.zeros((picks.size, 0))
    offset, sizes = reading_beyond(left[picks], fading)
    sought = zip(staged.coordinates, vector[staged.ceramic.start.size :], strict=True)
    values = {each.parameter: each.si(float(value)) for each, value in sought if each.run == number}
    values.update({each.parameter: each.start for each in staged.given if each.run == number})
    return replace(start, offset=offset, fading=sizes, values=tuple(values.items()))


def _going(staged: Staged, written: Sequence[int]) -> dict[str, dict[str, float]]:
    """What runs without an entry of their own are known to begin with, by parameter and fingerprint of the run."""
    found: dict[str, dict[str, float]] = {each.parameter: {} for each in staged.given}
    for each in staged.given:
        if each.run is not None and each.run not in written:
            found[each.parameter][staged.runs[each.run].record.sha256] = each.start
    return found


def _as_it_is_now(staged: Staged, vector: Array) -> Chain:
    """The chain of the stage, with all runs behind it where an effect goes on from run to run."""
    last = len(staged.runs) - 1
    before = {(each.kind, each.field): each.start for each in staged.given if each.run == last}
    polarization = staged.polarizations(vector)[last] if before else np.empty(0)

    def aged(link: Link) -> Link:
        field = EFFECT_OF[link.kind].goes_on if link.kind in EFFECT_OF else ""
        if not isinstance(link, GoesOn) or (link.kind, field) not in before:
            return link
        return replace(link, **{field: before[link.kind, field] + link.gone_through(polarization)})

    return staged.chain_at(vector).with_links(aged)


def _settles(run: RunData) -> bool:
    """Whether start and zero of a run are left to its beginning, as of any run that a model has not seen.

    So they are in all runs that score, unless a second of it holds next to nothing.
    """
    time = run.record.time
    return SCORE in run.picks and int(np.searchsorted(time, time[0] + SETTLE_TIME)) >= _FEWEST_TO_SETTLE


def estimates(hypothesis: Hypothesis) -> dict[str, dict[str, Any]]:
    """Value, standard error and unit [SI] of every parameter of the stage; an error is null where nothing tells it."""
    staged, solution = hypothesis.staged, hypothesis.solution
    declared = getattr(staged.ceramic, "coordinates", ())  # first in the vector; what is behind them belongs to runs
    coordinates = (*declared, *staged.coordinates)
    places = [*range(len(declared)), *range(staged.ceramic.start.size, staged.start.size)]
    covariance, undetermined = parameter_covariance(hypothesis.jacobians, solution.residuals, places)
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * model_error(hypothesis)
    found = {}
    for number, (place, each) in enumerate(zip(places, coordinates, strict=True)):
        if each.run is None:
            value = each.si(float(solution.vector[place]))
            known = not undetermined[number] and std[number] > 0.0
            error = float(std[number]) * abs(each.slope(value)) if known else None
            found[each.name] = {"value": value, "std": error, "unit": each.unit}
    return found


def model_error(hypothesis: Hypothesis) -> float:
    """Factor on standard errors: what a model is off by is alike all along a run and does not average out."""
    runs = [hypothesis.staged.runs[number] for number in hypothesis.staged.fitted]
    share = np.mean([(_MODEL_ERROR * np.ptp(run.record.displacement) / run.noise) ** 2 for run in runs])
    return math.sqrt(1.0 + hypothesis.fit.samples * float(share))


def errors_of(chain: Chain, runs: Sequence[RunData]) -> Errors:
    """Free-run prediction of every run as `pzt predict` makes it."""
    return errors_from([predict(chain, run.record).error for run in runs], runs)


def errors_from(residuals: Sequence[Array], runs: Sequence[RunData]) -> Errors:
    """The errors of any prediction, from measurement minus prediction of every run [m, each shape (n,)]."""
    picked = {
        part: [r[run.picks[part]] for r, run in zip(residuals, runs, strict=True) if part in run.picks]
        for part in (FIT, SELECTION, SCORE)
    }
    train = [r[run.since :] for r, run in zip(residuals, runs, strict=True) if FIT in run.picks]
    test = [r[run.since :] for r, run in zip(residuals, runs, strict=True) if SCORE in run.picks]
    tested = test or train
    spans = [float(np.ptp(run.record.displacement)) for run in runs if SCORE in run.picks or not test]
    score = _rms_of(picked[SCORE] or picked[FIT])
    return Errors(
        train=_rms_of(train),
        test=_rms_of(tested),
        selection=_rms_of(picked[SELECTION] or picked[FIT]),
        score=score,
        nrmse=math.sqrt(float(np.mean([(rms(r) / s) ** 2 for r, s in zip(tested, spans, strict=True)]))),
        interval=interval_95(picked[SCORE] or picked[FIT]),
        residuals=tuple(residuals),
    )


def _rms_of(residuals: Sequence[Array]) -> float:
    return rms(np.concatenate(residuals))


def interval_95(residuals: Sequence[Array]) -> tuple[float, float]:
    """95 % interval of an rms: the squares are averaged over as many samples as are independent."""
    effective = sum(max(effective_samples(r**2 - np.mean(r**2)), 2.0) for r in residuals)
    squares = np.concatenate(residuals) ** 2
    mean, error = float(np.mean(squares)), float(np.std(squares)) / math.sqrt(effective)
    return math.sqrt(max(mean - _NORMAL_95 * error, 0.0)), math.sqrt(mean + _NORMAL_95 * error)
