"""One run set judged: errors of generic models, of the declared and the identified base, and the library's verdict."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pzt_benchmarks.measured.sets import RunSet
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import diagnose
from pzt_ros.diagnosis.baselines import baselines
from pzt_ros.diagnosis.data import FIT, SCORE, SELECTION, RunData, split
from pzt_ros.diagnosis.flexible import ORDERS, ROTATIONS
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.report import Report
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.undeclared import fit_base
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record
from pzt_ros.sysid.identified_fit import IdentifiedFit
from pzt_ros.sysid.identified_problem import MeasuredRun
from pzt_ros.sysid.run import rms

LAST_CYCLE = "last cycle"
DECLARED, IDENTIFIED = "declared base", "identified base"

_THICKNESS = 1e-4  # [m]; stands for any, only the fields' ratio to the density's grid counts


@dataclass(frozen=True)
class Row:
    """Error of one model on the score part.

    Attributes:
        model: in words.
        error: rms [m].
        span: of the measurement over the whole test run [m].
        floor: its noise [m].
        chosen: rms on the part that chooses [m].
    """

    model: str
    error: float
    span: float
    floor: float
    chosen: float

    @property
    def percent(self) -> float:
        """Of the span."""
        return 100.0 * self.error / self.span

    def cells(self) -> tuple[str, ...]:
        """A row of the table."""
        error, chosen = 1e9 * self.error, 1e9 * self.chosen
        times = self.error / self.floor
        return self.model, f"{chosen:.4g}", f"{error:.4g}", f"{self.percent:.3f}", f"{times:.2f}"


HEADS = ("model", "selection, nm", "score, nm", "score, % of span", "score, x floor")


@dataclass(frozen=True)
class Judged:
    """What came out.

    Attributes:
        which: the set.
        test: the run that chose and scored.
        rows: the errors.
        residuals: of the test run, by model [m].
        choice: how fine and smooth the identified base is, in words.
        report: what `pzt diagnose` says.
        seconds: what that took.
    """

    which: RunSet
    test: RunData
    rows: tuple[Row, ...]
    residuals: dict[str, Array]
    report: Report
    seconds: float


def judge(which: RunSet, data: Path, tell: Callable[[str], None]) -> Judged:
    """Fit, choose and score one set."""
    train, test = [cut.record(data) for cut in which.train], which.test.record(data)
    runs = split(with_floors(train), with_floors([test]))
    chain = load_chain(which.chain) if which.chain else None
    residuals = {
        name: errors.residuals[-1] if name == LAST_CYCLE else centred(runs[-1], errors.residuals[-1])
        for name, errors in baselines(runs).items()
    }
    modelled = [_in_one(runs, which.whole(data))] if which.goes_on else runs
    declared = fit_base(chain, modelled, Thresholds(), tell, IN_THIS_PROCESS).declared
    residuals[DECLARED] = _late(_declared_error(declared), runs[-1])
    tell("identifying the density")
    residuals[IDENTIFIED] = _late(_identified_error(modelled), runs[-1])
    tell("diagnosing as a user would")
    began = time.perf_counter()
    report = diagnose(train, [test], chain, progress=tell)
    seconds = time.perf_counter() - began
    rows = tuple(row(name, runs[-1], residual) for name, residual in residuals.items())
    return Judged(which, runs[-1], rows, residuals, report, seconds)


def row(name: str, run: RunData, residual: Array) -> Row:
    """Errors of a residual of the test run [m]."""
    score, chosen = residual[run.picks[SCORE]], residual[run.picks[SELECTION]]
    return Row(name, rms(score), float(np.ptp(run.record.displacement)), run.noise, rms(chosen))


def centred(run: RunData, residual: Array) -> Array:
    """With its zero where the part that chooses has it."""
    return residual - float(np.mean(residual[run.picks[SELECTION]]))


def _in_one(runs: Sequence[RunData], whole: Record) -> RunData:
    """The parts of a train run and of the test run that follows on it, in the record that both are of."""
    train, test = runs
    later = len(whole) - len(test.record)
    picks = {part: samples + later for part, samples in test.picks.items()}
    return RunData(whole, {FIT: np.arange(len(train.record)), **picks}, train.noise)


def _late(residual: Array, test: RunData) -> Array:
    """As many samples as the test run has, with the zero where the part that chooses has it."""
    return centred(test, residual[-len(test.record) :])


def _declared_error(found: Hypothesis) -> Array:
    """Measurement minus prediction of the last run [m]; what was before it was fitted to the part that chooses."""
    runs = found.staged.runs
    displacement, _ = found.staged.outputs(found.vector, [len(runs) - 1])[0]
    return runs[-1].record.displacement - displacement


def _identified_error(runs: Sequence[RunData]) -> Array:
    """The same of the identified density, fitted to the train runs and the part that chose."""
    fitted = [_measured(run) for run in runs if FIT in run.picks]
    others = [_measured(run) for run in runs if FIT not in run.picks]
    others = [replace(run, counted=run.chooses) for run in others]
    fit = IdentifiedFit(_THICKNESS, rotations=ROTATIONS, orders=ORDERS)
    found = fit.fit(fitted, others)
    everything = [_all_fitted(run) for run in (*fitted, *others)]
    found = fit.only(found.choices[0]).fit(everything)
    return runs[-1].record.displacement - found.problem.predict(found.vector)[-1]


def _all_fitted(run: MeasuredRun) -> MeasuredRun:
    """What chose is fitted, too, once everything is chosen."""
    return run if run.chooses is None else replace(run, counted=run.counted | run.chooses, chooses=None)


def _measured(run: RunData) -> MeasuredRun:
    """With masks of what is fitted and what chooses."""
    record = run.record
    masks = {part: np.zeros(len(record), dtype=bool) for part in (FIT, SELECTION)}
    for part, mask in masks.items():
        mask[run.picks.get(part, [])] = True
    chooses = masks[SELECTION] if SELECTION in run.picks else None
    return MeasuredRun(record.time, record.voltage, record.displacement, run.noise, masks[FIT], chooses=chooses)
