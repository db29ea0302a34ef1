"""What a story came to: tracking and prediction before and after the repair, and whether the diagnosis was right."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.report import Report
from pzt_ros.experiments.phases import Scan
from pzt_ros.physics.link import Link
from pzt_ros.quantities import parameters_of
from pzt_ros.report.rundata import RunData
from pzt_ros.report.tracking import TrackingError
from pzt_ros.story.runs import AS_KNOWN, FITTED, MODEL_OF, REPAIRED, SCANS, data_of, record_of
from pzt_ros.sysid.predict import Prediction, predict

NAMED, AMONG, PAIR, SOMETHING, WRONG, NOTHING = "named", "among others", "pair", "something", "wrong", "nothing"
"""What a diagnosis can come to, from best to worst."""


@dataclass(frozen=True)
class Story:
    """A story that was told to its end.

    Attributes:
        folder: of all its runs.
        seed: that drew the hidden effect.
        hidden: the link that the stage had and its model had not.
        report: of the diagnosis.
        scans: what was recorded, by name of the run.
        predictions: of the last run, which no fit and no choice has seen, by name of the run whose model predicts.
        four: numbers of the run with four controllers; empty where it was left out.
        command, seconds: how the story was told, and how long it took.
    """

    folder: Path
    seed: int
    hidden: Link
    report: Report
    scans: Mapping[str, RunData]
    predictions: Mapping[str, Prediction]
    four: Mapping[str, Any]
    command: str
    seconds: float

    @cached_property
    def tracking(self) -> dict[str, dict[str, TrackingError]]:
        """Error against the true displacement, by run and controller."""
        return {
            run: {row.stretch.controller: row.judged for row in data.tracked() if isinstance(row.stretch.phase, Scan)}
            for run, data in self.scans.items()
        }

    @property
    def controllers(self) -> list[str]:
        """Those that scanned in every run."""
        return [name for name in self.tracking[AS_KNOWN] if all(name in rows for rows in self.tracking.values())]

    @property
    def answer(self) -> str:
        """One of NAMED, AMONG, PAIR, SOMETHING, WRONG, NOTHING."""
        found = [effect.name for effect in self.report.effects]
        tied = {name for group in self.report.not_identifiable for name in group}
        if self.hidden.kind in found:
            return NAMED if len(found) == 1 and not tied and not self.report.remains.present else AMONG
        if self.hidden.kind in tied:
            return PAIR
        if found or tied:
            return WRONG
        return SOMETHING if self.report.remains.present else NOTHING

    def tracking_gain(self, controller: str, before: str = FITTED) -> float:
        """RMS error of a run over that of the repaired one [-]."""
        return _ratio(self.tracking[before][controller].rms, self.tracking[REPAIRED][controller].rms)

    def prediction_gain(self, before: str = FITTED) -> float:
        """RMS error of the prediction by a run's model over that by the repaired one [-]."""
        return _ratio(self.predictions[before].rms, self.predictions[REPAIRED].rms)

    def as_data(self) -> dict[str, Any]:
        """The numbers for programs; SI, the unit in the name."""
        return {
            "schema": 1,
            "simulated": True,
            "seed": self.seed,
            "hidden": {"name": self.hidden.kind, "parameters": values_of(self.hidden)},
            "answer": self.answer,
            "diagnosis": {
                "verdict": self.report.verdict,
                "effects": [
                    {"name": e.name, "probability": e.probability, "parameters": e.parameters}
                    for e in self.report.effects
                ],
                "not_identifiable": [list(group) for group in self.report.not_identifiable],
                "unexplained": self.report.remains.present,
                "noise_rms_m": self.report.noise,
                "test_rms_before_m": self.report.before.test,
                "test_rms_after_m": self.report.after.test,
                "duration_s": self.report.seconds,
            },
            "prediction": {run: {"rms_m": found.rms} for run, found in self.predictions.items()},
            "prediction_gain": self.prediction_gain(),
            "tracking": {
                run: {name: {"rms_m": error.rms, "max_m": error.maximum} for name, error in rows.items()}
                for run, rows in self.tracking.items()
            },
            "tracking_gain": {name: self.tracking_gain(name) for name in self.controllers},
            "controllers": dict(self.four),
            "command": self.command,
            "duration_s": self.seconds,
        }


def told(
    folder: Path, seed: int, hidden: Link, report: Report, four: Mapping[str, Any], command: str, seconds: float
) -> Story:
    """The story out of the runs in its folder.

    Raises:
        BenchError: a run is missing or damaged.
    """
    unseen = record_of(folder, REPAIRED)
    models = {run: model_path(folder, run) for run in SCANS}
    predictions = {run: predict(load_chain(path), unseen) for run, path in models.items()}
    scans = {run: data_of(folder, run) for run in SCANS}
    return Story(folder, seed, hidden, report, scans, predictions, four, command, seconds)


def model_path(folder: Path, run: str) -> str:
    """The chain that observer and controllers loaded in a run: a shipped name, or a path."""
    name = MODEL_OF[run]
    return str(folder / name) if name.endswith(".yaml") else name


def values_of(link: Link) -> dict[str, dict[str, Any]]:
    """Value and unit [SI] of every parameter of a link."""
    return {name: {"value": getattr(link, name), "unit": p.unit} for name, p in parameters_of(link).items()}


def _ratio(before: float, after: float) -> float:
    return before / after if after > 0.0 else float("inf")
