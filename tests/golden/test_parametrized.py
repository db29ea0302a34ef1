"""The parametrized model against the reference solutions of the thesis' equations (data/README.md)."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from pzt_ros.physics import parametrized_branch as branch
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.signals import Array, Rest, Signals

DATA = Path(__file__).parent / "data"

P1 = Parametrized(
    shape_ascending=0.9,
    barrier_ascending=0.5e6,
    shape_descending=0.9,
    barrier_descending=0.5e6,
    relaxation_time=5e-2,
    domain_polarization=0.215,
    reciprocal_permittivity=2.8e7,
)
P2 = Parametrized(
    shape_ascending=2.5,
    barrier_ascending=0.25e6,
    shape_descending=1.1,
    barrier_descending=1.0e6,
    relaxation_time=8e-2,
    domain_polarization=0.210,
    reciprocal_permittivity=2.5e7,
)
P3 = Parametrized(
    shape_ascending=1.3,
    barrier_ascending=0.5e6,
    shape_descending=1.3,
    barrier_descending=0.5e6,
    relaxation_time=1e-3,
    domain_polarization=0.26,
    reciprocal_permittivity=6e7,
    virgin_amplitude=2.0e6,
)
LINKS = {"P1": P1, "P2": P2, "P3": P3, "P4": P2}

PRERUNS = sorted(DATA.glob("P*_virgin_prerun.csv"))
CASES = sorted(set(DATA.glob("P*.csv")) - set(PRERUNS))


class Reference(NamedTuple):
    time: Array
    field: Array
    phase_fraction: Array
    polarization: Array


def read(path: Path) -> Reference:
    return Reference(*np.loadtxt(path, delimiter=",", skiprows=1, usecols=(0, 1, 2, 3)).T.copy())


def link_of(path: Path, **changes: object) -> Parametrized:
    return dataclasses.replace(LINKS[path.name[:2]], **changes)


def drive(link: Parametrized, time: Array, field: Array) -> tuple[Array, Signals]:
    return link.step(link.init(Rest()), Signals(time=time, voltage=field * link.layer_thickness))


def assert_close(found: Signals, rows: Array | slice, reference: Reference, tolerance: float) -> None:
    assert found.phase_fraction is not None
    assert found.polarization is not None
    np.testing.assert_allclose(found.phase_fraction[rows], reference.phase_fraction, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.polarization[rows], reference.polarization, rtol=0, atol=tolerance)


def field_reversals(field: Array) -> int:
    slopes = np.sign(np.diff(field))
    slopes = slopes[slopes != 0]
    return int(np.count_nonzero(np.diff(slopes)))


def test_the_reference_is_there() -> None:
    assert len(CASES) == 9
    assert len(PRERUNS) == 3


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_load_cases_from_their_rows_alone(path: Path) -> None:
    reference = read(path)
    state, found = drive(link_of(path, accuracy=1e-8), reference.time, reference.field)
    assert_close(found, slice(None), reference, 1e-6)
    assert state[branch.REVERSALS] == field_reversals(reference.field)


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_load_cases_at_20_khz_and_default_accuracy(path: Path) -> None:
    reference = read(path)
    grid = np.arange(1, int(reference.time[-1] * 20e3)) / 20e3
    time = np.unique(np.round(np.concatenate((grid, reference.time)), 10))
    rows = nearest(time, reference)
    state, found = drive(link_of(path), time, np.interp(time, reference.time, reference.field))
    assert_close(found, rows, reference, 1e-5)
    assert state[branch.REVERSALS] == field_reversals(reference.field)


def nearest(time: Array, reference: Reference) -> Array:
    after = np.clip(np.searchsorted(time, reference.time), 1, time.size - 1)
    closer_before = reference.time - time[after - 1] < time[after] - reference.time
    return after - closer_before


@pytest.mark.parametrize("path", PRERUNS, ids=lambda path: path.stem)
def test_virgin_prerun_from_negative_saturation(path: Path) -> None:
    reference = read(path)
    link = link_of(path, start="negative", accuracy=1e-8)
    time = np.linspace(0.0, 1.0, 100_001)
    _, found = drive(link, time, link.virgin_amplitude * np.sin(20 * np.pi * time) * (1 - time))
    assert_close(found, nearest(time, reference), reference, 1e-6)


def test_virgin_start_is_the_end_of_the_prerun() -> None:
    for path in PRERUNS:
        reference = read(path)
        link = link_of(path)
        _, found = link.step(link.init(Rest()), Signals(time=np.array([0.0]), voltage=np.array([0.0])))
        assert found.phase_fraction is not None
        assert found.phase_fraction[0] == pytest.approx(reference.phase_fraction[-1], abs=1e-6)
