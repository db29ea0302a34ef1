"""One case tried: made, written, diagnosed, and the report held against the truth. The only part that knows pzt_ros."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.errors import BenchError
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.records import read_csv
from pzt_ros.sysid.predict import predict

from .cases import Case, Spec, make_case
from .drives import Drive
from .files import CaseFiles, read_run, write_case, write_run
from .generator import NOISE, more_runs
from .outcome import RIGHT, Covered, Outcome, outcome_for

Diagnosis = Callable[[CaseFiles, Path], None]
"""From a case to `report.json`, `baseline.yaml` and `model.yaml` in a folder."""

NEXT_DRIVE = "next_experiment.csv"
"""Beside report.json: the drive of the proposed next experiment, `time_s, voltage_V`; the court makes the run."""

PATIENCE = 900
"""Seconds after which a diagnosis counts as failed."""

_LONGEST = 120.0  # seconds of a proposed experiment
_HIGHEST = 150.0  # volts of a proposed experiment


class TooSlow(Exception):  # noqa: N818 - no error of the case
    """A diagnosis went on for longer than PATIENCE."""


def library_diagnosis(files: CaseFiles, out: Path) -> None:
    """What `pzt diagnose` does, without the page."""
    chain = load_chain(files.declared) if files.declared else None
    train, test = ([read_csv(path) for path in paths] for paths in (files.train, files.test))
    report = diagnose(train, test, chain, workers=IN_THIS_PROCESS)  # other cases are tried beside it
    report.save_data(out)


@dataclass(frozen=True)
class Trial:
    """How cases are tried.

    Attributes:
        folder: where each case has its own folder.
        diagnosis: what is judged.
        keep: whether the runs stay there afterwards.
    """

    folder: Path
    diagnosis: Diagnosis = library_diagnosis
    keep: bool = False

    def __call__(self, spec: Spec) -> Outcome:
        """Try one case; whatever goes wrong in the diagnosis is an outcome."""
        case = make_case(spec)
        bare = outcome_for(spec, reached=case.sizes)
        if not bare.reachable:
            return bare
        files = write_case(case, self.folder / spec.name)
        out = files.folder / "out"
        try:
            return self._tried(case, files, out, bare)
        except TooSlow:
            return replace(bare, failure=f"no report after {PATIENCE} s")
        except Exception as error:  # any failure of what is judged is a result, not the end of the court
            return replace(bare, failure=f"{type(error).__name__}: {error}")
        finally:
            if not self.keep:
                for path in (*files.train, *files.test, *files.score):
                    path.unlink(missing_ok=True)
                shutil.rmtree(files.folder / "next", ignore_errors=True)

    def _tried(self, case: Case, files: CaseFiles, out: Path, bare: Outcome) -> Outcome:
        began = time.monotonic()
        with _patience(PATIENCE):
            self.diagnosis(files, out)
        seconds = time.monotonic() - began
        report = _report(out)
        found = replace(
            bare,
            **_said(report),
            seconds=seconds,
            megabytes=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            before=_score(out / "baseline.yaml", files.score),
            after=_score(out / "model.yaml", files.score),
        )
        if found.verdict == RIGHT:
            found = replace(found, parameters=tuple(_covered(case, report)))
        if case.spec.kind == "confounded" and found.groups and (out / NEXT_DRIVE).exists():
            found = replace(found, separated=self._separated(case, files, out))
        return found

    def _separated(self, case: Case, files: CaseFiles, out: Path) -> bool:
        """Whether a second diagnosis, with the proposed run made twice, names what is hidden."""
        more = more_runs(case.bench, proposed(out / NEXT_DRIVE), 2)
        folder = files.folder / "next"
        folder.mkdir(exist_ok=True)
        paths = []
        for number in range(2):
            paths.append(folder / f"next-{number + 1}.csv")
            write_run(paths[-1], more.record(number, case.effects, case.spec.reading))
        with _patience(PATIENCE):
            self.diagnosis(replace(files, train=(*files.train, paths[0]), test=(*files.test, paths[1])), folder / "out")
        found = outcome_for(case.spec, **_said(_report(folder / "out")))
        return found.verdict == RIGHT


def proposed(path: Path) -> Drive:
    """A proposed drive as the bench would play it: at the rate it is written in, within what the actuator stands.

    Raises:
        BenchError: it leaves that.
    """
    columns = read_run(path)
    time_s, voltage = columns["time_s"], columns["voltage_V"]
    if time_s[-1] - time_s[0] > _LONGEST or np.max(np.abs(voltage)) > _HIGHEST:
        raise BenchError(f"{path}: longer than {_LONGEST:g} s or beyond {_HIGHEST:g} V; propose what the bench can do")
    step = max(float(np.median(np.diff(time_s))), 1e-4) if time_s.size > 1000 else 1e-3
    even = np.arange(0.0, time_s[-1] - time_s[0], step)
    return Drive(even, np.interp(even, time_s - time_s[0], voltage))


def _report(out: Path) -> dict[str, Any]:
    report: dict[str, Any] = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return report


def _said(report: dict[str, Any]) -> dict[str, Any]:
    """What a report says is missing."""
    return {
        "named": tuple(each["name"] for each in report["effects"]),
        "groups": tuple(tuple(group) for group in report["not_identifiable"]),
        "unexplained": bool(report["unexplained"]["present"]),
    }


def _score(model: Path, runs: tuple[Path, ...]) -> tuple[float, ...]:
    """Error of a free-run prediction on each run over the noise, as `pzt predict` states it."""
    chain = load_chain(model)
    return tuple(predict(chain, read_csv(path)).rms / NOISE for path in runs)


def _covered(case: Case, report: dict[str, Any]) -> Iterator[Covered]:
    """Parameters that truth and report both have."""
    for effect in case.effects:
        said = next(each["parameters"] for each in report["effects"] if each["name"] == effect.name)
        for name, value in effect.parameters().items():
            estimate = said.get(name)
            if estimate is not None and estimate.get("std") and np.isfinite(estimate["std"]):
                yield Covered(effect.name, name, float(value), float(estimate["value"]), float(estimate["std"]))


@contextmanager
def _patience(seconds: int) -> Iterator[None]:
    """Interrupt what takes too long; in the main thread of a process only."""

    def interrupt(*_: object) -> None:
        raise TooSlow

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
