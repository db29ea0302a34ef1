"""What a diagnosis found: one object, from which report.json, the model files and the page are written."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pzt_ros.chains import save_chain
from pzt_ros.diagnosis import next_experiment
from pzt_ros.diagnosis.data import RunData
from pzt_ros.diagnosis.next_experiment import NextExperiment
from pzt_ros.diagnosis.outcome import Errors
from pzt_ros.diagnosis.remains import Remains
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain

SCHEMA = 1


@dataclass(frozen=True)
class FoundEffect:
    """An effect that was added.

    Attributes:
        name, place: of the effect, and where in the chain it stands.
        test_rms_before, test_rms_after: [m], without and with it.
        parameters: value, std and unit [SI] by name.
        probability: that it, and not chance or another effect of the library, is what was missing.
    """

    name: str
    place: str
    test_rms_before: float
    test_rms_after: float
    parameters: dict[str, dict[str, Any]]
    probability: float


@dataclass(frozen=True)
class Tried:
    """A candidate and what became of it.

    Attributes:
        step: of the search, from 1.
        base: density of the base that it was tried on, "gaussian", "identified" or "none".
        name: of the effect.
        test_rms: with it [m]; NaN where it was not refitted.
        fit_gain, selection_gain: n_eff ln(before/after); NaN as above.
        fit_share, selection_share: of the excess over the noise; NaN as above.
        accepted: whether it was added.
        why: in words.
    """

    step: int
    base: str
    name: str
    test_rms: float
    fit_gain: float
    selection_gain: float
    fit_share: float
    selection_share: float
    accepted: bool
    why: str


@dataclass(frozen=True)
class Report:
    """The outcome of `diagnose`.

    Attributes:
        train, test: the runs.
        noise: floor of the displacement, mean over the runs [m].
        base: which hysteresis the effects were added to, as report.json says it.
        before, after: errors of the declared model and of the repaired one.
        baseline, model: those two as chains.
        effects: added, in order.
        tried: every candidate.
        not_identifiable: groups of names any of which explains the residual as well.
        remains: what is left after the repair.
        next_experiment: what would decide or show more.
        verdict: in one sentence.
        baselines: name of a generic model -> errors of it, for comparison.
        remarks: what a reader has to know beside.
        command, seconds: how and how long.
        next_drive: that of `next_experiment`, where one is needed.
        is_cut: whether the time limit was reached before all was tried.
    """

    train: tuple[RunData, ...]
    test: tuple[RunData, ...]
    noise: float
    base: dict[str, Any]
    before: Errors
    after: Errors
    baseline: Chain
    model: Chain
    effects: tuple[FoundEffect, ...]
    tried: tuple[Tried, ...]
    not_identifiable: tuple[tuple[str, ...], ...]
    remains: Remains
    next_experiment: str
    verdict: str
    baselines: dict[str, Errors] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    command: str = ""
    seconds: float = 0.0
    next_drive: NextExperiment | None = None
    is_cut: bool = False

    @property
    def runs(self) -> tuple[RunData, ...]:
        """All of them, train first."""
        return (*self.train, *self.test)

    @property
    def repaired(self) -> bool:
        """Whether an effect was added: alone, or as the first of a group that the runs cannot tell apart."""
        return bool(self.effects) or any(group[0] in EFFECT_OF for group in self.not_identifiable)

    def as_data(self) -> dict[str, Any]:
        """The content of report.json (contract.md, schema 1); SI, the unit in the name."""
        return {
            "schema": SCHEMA,
            "train": [run.record.name for run in self.train],
            "test": [run.record.name for run in self.test],
            "noise_rms_m": self.noise,
            "base": self.base,
            "before": _errors_as_data(self.before, self.noise),
            "after": _errors_as_data(self.after, self.noise),
            "effects": [_effect_as_data(effect) for effect in self.effects],
            "candidates": [_tried_as_data(tried) for tried in self.tried],
            "not_identifiable": [list(group) for group in self.not_identifiable],
            "unexplained": {
                "rms_m": self.remains.rms,
                "times_noise": self.remains.times_noise,
                "present": self.remains.present,
                "what_is_seen": self.remains.what_is_seen,
            },
            "next_experiment": self.next_experiment,
            "verdict": self.verdict,
            "baselines": {name: _errors_as_data(errors, self.noise) for name, errors in self.baselines.items()},
            "remarks": list(self.remarks),
            "runs": [
                {"name": run.record.name, "sha256": run.record.sha256, "noise_rms_m": run.noise} for run in self.runs
            ],
            "command": self.command,
            "duration_s": self.seconds,
            "time_limit_reached": self.is_cut,
        }

    def save(self, out: Path) -> None:
        """Write what `save_data` does, and report.html.

        Raises:
            BenchError: the folder cannot be written.
        """
        from pzt_ros.diagnosis.page import write_page  # plotting only where a page is made

        self.save_data(out)
        write_page(self, out / "report.html")

    def save_data(self, out: Path) -> None:
        """Write report.json, baseline.yaml, model.yaml, and next_experiment.csv where a next experiment is needed.

        Raises:
            BenchError: the folder cannot be written.
        """
        try:
            out.mkdir(parents=True, exist_ok=True)
            text = json.dumps(_finite(self.as_data()), indent=1)
            (out / "report.json").write_text(text + "\n", encoding="utf-8")
            next_experiment.save(self.next_drive, out)
        except OSError as error:
            raise BenchError(f"report folder '{out}' cannot be written: {error.strerror}") from None
        save_chain(self.baseline, out / "baseline.yaml")
        save_chain(self.model, out / "model.yaml")


def _errors_as_data(errors: Errors, noise: float) -> dict[str, Any]:
    return {
        "train_rms_m": errors.train,
        "test_rms_m": errors.test,
        "test_nrmse": errors.nrmse,
        "selection_rms_m": errors.selection,
        "score_rms_m": errors.score,
        "score_interval_m": list(errors.interval),
        "score_times_noise": errors.score / noise,
    }


def _effect_as_data(effect: FoundEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "link": effect.place,
        "test_rms_before_m": effect.test_rms_before,
        "test_rms_after_m": effect.test_rms_after,
        "parameters": effect.parameters,
        "probability": effect.probability,
    }


def _tried_as_data(tried: Tried) -> dict[str, Any]:
    return {
        "step": tried.step,
        "base": tried.base,
        "name": tried.name,
        "test_rms_m": tried.test_rms,
        "fit_gain": tried.fit_gain,
        "selection_gain": tried.selection_gain,
        "fit_share": tried.fit_share,
        "selection_share": tried.selection_share,
        "accepted": tried.accepted,
        "why": tried.why,
    }


def _finite(data: Any) -> Any:
    """The same with null for numbers that JSON has not."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, Sequence) and not isinstance(data, str):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data
