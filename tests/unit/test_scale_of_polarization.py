"""An identified density is as polarized as was recorded, or else as was declared; runs of the court's plays."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import Spec, make_case
from pzt_benchmarks.residual_court.files import write_case
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.flexible import fit_flexible, fit_rate_independent
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.physics.signals import Array
from pzt_ros.records import Record, read_csv

PLAYS = Spec("null_wrong", "play_sum", protocol="short", seed=5)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Hypothesis:
    """The declared model, whose density is another one."""
    files = write_case(make_case(PLAYS), tmp_path_factory.mktemp("plays"))
    assert files.declared is not None
    train, test = ([read_csv(path) for path in paths] for paths in (files.train, files.test))
    runs = with_floors((*train, *test))
    return fit_declared(load_chain(files.declared), split(runs[: len(train)], runs[len(train) :]), lambda text: None)


def span(found: Hypothesis, vector: Array | None = None) -> float:
    """Of the polarization in the runs that were fitted [C/m^2]."""
    polarizations = found.staged.polarizations(found.vector if vector is None else vector)
    return max(float(np.ptp(polarizations[number])) for number in found.staged.fitted)


@pytest.mark.parametrize("identify", [fit_rate_independent, pytest.param(fit_flexible, marks=pytest.mark.long)])
def test_it_is_as_large_as_declared(model: Hypothesis, identify) -> None:  # type: ignore[no-untyped-def]
    found = identify(model, lambda text: None)
    assert span(found) == pytest.approx(span(model, model.staged.start), rel=0.02)
    assert found.fit.ratio < model.fit.ratio
    again = identify(found, lambda text: None)
    assert span(again) == pytest.approx(span(found), rel=0.02)


def test_it_is_as_large_as_recorded(model: Hypothesis) -> None:
    def recorded(record: Record, polarization: Array) -> Record:
        return Record(record.name, {**record.columns, "polarization_C_per_m2": 3.0 * polarization})

    staged = model.staged
    polarizations = staged.polarizations(staged.start)
    pairs = zip(staged.runs, polarizations, strict=True)
    runs = [dataclasses.replace(r, record=recorded(r.record, p), polarization_noise=1e-3) for r, p in pairs]
    found = fit_rate_independent(dataclasses.replace(model, staged=dataclasses.replace(staged, runs=runs)), print)
    assert found is not None
    assert span(found) == pytest.approx(3.0 * span(model, staged.start), rel=0.1)
