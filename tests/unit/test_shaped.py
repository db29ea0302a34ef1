"""Stages whose densities are no Gaussians, and quadratures that are too coarse: what is missing is no effect."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from ramps_and_holds import FIELDS, NOISE, runs_of
from scipy import stats

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis import lopsided as lopsided_of
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.lopsided import lopsided_instead
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.shaped import is_shaped, shaped
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.density import Table
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.quadrature import Quadrature

_stats: Any = stats  # SciPy carries no types


def skewed() -> Chain:
    """Gamma coercive and logistic interaction fields, as tables: near what a shaped density can be, and not it."""
    coercive, interaction = np.linspace(0.0, 2.5e6, 400), np.linspace(-1.6e6, 1.6e6, 400)
    gamma = _stats.gamma(a=4.0, scale=1.5e5).pdf(coercive)
    logistic = _stats.logistic(scale=1.3e5).pdf(interaction)
    tables = {
        "coercive_density": Table(tuple(coercive), tuple(gamma)),
        "interaction_density": Table(tuple(interaction), tuple(logistic)),
    }
    return _stage(Front(**FIELDS, **tables))


def lopsided(skew: float = 3.0, scale: float = 5e5) -> Chain:
    """Skewed normal interaction fields, densest at 0, as a table: near what a lopsided density can be, and not it."""
    fields = np.linspace(-1.6e6, 1.6e6, 801)
    wide = _stats.skewnorm(a=skew, scale=scale)
    mode = fields[np.argmax(wide.pdf(fields))]
    return _stage(Front(**FIELDS, interaction_density=Table(tuple(fields), tuple(wide.pdf(fields + mode)))))


def _stage(ceramic: Ferroelectric) -> Chain:
    def instead(link: Link) -> Link:
        return ceramic if isinstance(link, Ferroelectric) else link

    return load_chain("thesis-p2").with_links(instead)


def declared_as(ceramic: type) -> Chain:
    """Gaussians, a fifth off."""
    wrong = {name: 1.2 * value for name, value in FIELDS.items() if name != "domain_polarization"}
    return _stage(ceramic(**wrong))


@pytest.mark.parametrize("declared", [None, declared_as(Lattice)])
def test_a_density_that_is_no_gaussian_is_no_effect(declared: Chain | None) -> None:
    report = diagnose(*runs_of(skewed()), declared, workers=IN_THIS_PROCESS)
    assert (report.effects, report.remains.present) == ((), False)
    assert report.base["density"] == "shaped"
    assert any("no Gaussians" in remark for remark in report.remarks)
    assert report.after.test < 1.1 * NOISE
    assert report.model.links[0].coercive_field_skew > 0.1  # type: ignore[attr-defined]


@pytest.mark.parametrize(("skew", "scale"), [(1.5, 4e5), pytest.param(3.0, 5e5, marks=pytest.mark.long)])
def test_interaction_fields_that_prefer_a_direction_are_no_effect(skew: float, scale: float) -> None:
    """Beside Gaussians a curve of the sensor and a bias field explain nearly all that a little of it leaves."""
    report = diagnose(*runs_of(lopsided(skew, scale)), declared_as(Lattice), workers=IN_THIS_PROCESS)
    assert (report.effects, report.remains.present) == ((), False)
    assert report.after.test < 1.1 * NOISE
    assert abs(report.model.links[0].interaction_field_skew) > 0.05  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("plant", "is_direction"),
    [(lopsided(), True), (with_effect(_stage(Lattice(**FIELDS)), BiasField(bias_voltage=8.0)), False)],
)
def test_a_bias_field_is_no_direction_that_the_fields_prefer(plant: Chain, is_direction: bool) -> None:
    runs = split(with_floors(runs_of(plant)[0]), [])
    base, search = begun(declared_as(Lattice), runs), Search()
    steps = [search.step(base)]
    assert (lopsided_instead(base, steps, search) is not None) is is_direction


@pytest.mark.parametrize(
    ("effects", "beside", "biased", "is_found"),
    [
        (("sensor_nonlinearity",), 1.01, 2.0, True),
        (("sensor_nonlinearity",), 1.3, 2.0, False),  # something is left beside it
        (("sensor_nonlinearity",), 1.01, 1.01, False),  # so much a bias field explains, too
        (("bias_field",), 1.01, 2.0, False),  # which is much the same to such fields
        ((), 1.01, 2.0, False),
    ],
)
def test_fields_that_prefer_a_direction_are_seen_beside_an_effect_that_hides_them(
    monkeypatch: pytest.MonkeyPatch, effects: tuple[str, ...], beside: float, biased: float, is_found: bool
) -> None:
    """A court case: a curve of 10 x beside tilted thresholds, of which such fields without it left half."""
    declared, found, there = leaving(6.4), leaving(2.0, effects), leaving(beside, effects)
    steps: Any = [SimpleNamespace(after=found, candidates=(), tied=())]
    with_direction(monkeypatch, declared, there, biased)
    base = lopsided_instead(declared, steps, Search())
    assert base == ((there, *effects) if is_found else None)


@pytest.mark.parametrize(
    ("tied", "share", "is_found"),
    [
        (("sensor_nonlinearity", "imprint", "strain_law"), 0.97, True),
        (("sensor_nonlinearity", "imprint", "strain_law"), 0.8, False),  # not nearly all of what they leave
        (("sensor_nonlinearity", "strain_law"), 0.97, False),  # no bias field is as good
    ],
)
def test_fields_that_prefer_a_direction_are_seen_beside_what_a_tie_of_their_likes_hides(
    monkeypatch: pytest.MonkeyPatch, tied: tuple[str, ...], share: float, is_found: bool
) -> None:
    """A court case: a current limit of 10 x, told beside a curve or a bias field that were neither there."""
    limit = ("amplifier_charge_limit",)
    declared, found, there = leaving(5.0), leaving(2.0, ("sensor_nonlinearity", *limit)), leaving(1.0, limit)
    curve = SimpleNamespace(after=leaving(1.7, ("sensor_nonlinearity",)), candidates=(), tied=tied)
    beside = SimpleNamespace(after=found, fit_share=share)
    steps: Any = [curve, SimpleNamespace(after=curve.after, candidates=(beside,), tied=())]
    with_direction(monkeypatch, declared, there, 4.0)
    bare = leaving(4.5, limit)
    monkeypatch.setattr(
        lopsided_of, "without", lambda each, name: bare if each is found and name == tied[0] else (each, name)
    )
    left = {id(declared): leaving(4.3), id(bare): there}
    monkeypatch.setattr(lopsided_of, "lopsided", lambda place: left.get(id(place), leaving(9.0)))
    base = lopsided_instead(declared, steps, Search())
    assert base == ((there, *limit) if is_found else None)


def with_direction(monkeypatch: pytest.MonkeyPatch, declared: Any, there: Any, biased: float) -> None:
    """Such fields leave 4.3 x without an effect, `there` beside one; a bias field beside that so much."""
    monkeypatch.setattr(lopsided_of, "may_be_lopsided", lambda found: True)
    monkeypatch.setattr(lopsided_of, "_places", lambda declared: [declared])
    monkeypatch.setattr(lopsided_of, "lopsided", lambda place: leaving(4.3) if place is declared else there)
    monkeypatch.setattr(lopsided_of, "exact", lambda found: found)
    monkeypatch.setattr(lopsided_of, "without", lambda found, name: (found, name))
    monkeypatch.setattr(Search, "with_effects", lambda self, base, names: leaving(biased))


def leaving(ratio: float, effects: tuple[str, ...] = ()) -> Any:
    """What is asked of a hypothesis that leaves so many times the noise in each of two runs."""
    total = 2.0 * ratio**2
    left = SimpleNamespace(ratio=ratio)
    return SimpleNamespace(
        fit=left, selection=left, ratios=[ratio] * 2, total=total, excess=total - 2.0, effects=effects, beside=""
    )


@pytest.mark.parametrize(
    ("declared", "hum"), [pytest.param(None, 4e-8, marks=pytest.mark.long), (declared_as(Lattice), 1.5e-8)]
)
def test_an_effect_beside_it_is_named(declared: Chain | None, hum: float) -> None:
    """A small one where the declared Gaussians leave ten times as much: shapes are free before it is sought."""
    plant = with_effect(skewed(), MainsHum(frequency=50.0, sine=hum))
    report = diagnose(*runs_of(plant), declared, workers=IN_THIS_PROCESS)
    assert [effect.name for effect in report.effects] == ["mains_hum"]
    assert not report.remains.present


def test_gaussians_stay_what_they_are() -> None:
    runs = split(with_floors(runs_of(_stage(Lattice(**FIELDS)))[0]), [])
    gaussian = begun(declared_as(Lattice), runs)
    free = shaped(gaussian)
    assert [is_shaped(each) for each in (gaussian, free)] == [False, True]
    assert shaped(free) is free
    places = [place for place, name in enumerate(free.staged.ceramic.names) if "skew" in name or "tail" in name]
    assert len(places) == 3
    assert np.all(np.abs(free.vector[places]) < 0.03)


@pytest.mark.parametrize("coarse", [False, True])
def test_a_quadrature_stays_one_only_where_its_nodes_are_the_specimen(coarse: bool) -> None:
    """The thesis' nodes are off by 0.7 % of x+, many times the noise."""
    plant = _stage(Quadrature(**FIELDS) if coarse else Lattice(**FIELDS))
    report = diagnose(*runs_of(plant), declared_as(Quadrature), workers=IN_THIS_PROCESS)
    assert (report.effects, report.remains.present) == ((), False)
    assert report.base["model"] == ("quadrature" if coarse else "lattice")
    assert report.after.test < 1.1 * NOISE
    told = [remark for remark in report.remarks if "nodes of the declared quadrature" in remark]
    assert len(told) == (0 if coarse else 1)
    free = dataclasses.replace(report.model, notes={})
    assert {link.kind for link in free.links} >= {report.base["model"]}
