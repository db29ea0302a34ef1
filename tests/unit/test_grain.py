"""Stages simulated with the thesis' own nodes, of which nothing was declared; and what a search does not do twice."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import pytest
from ramps_and_holds import FIELDS, NOISE, runs_of

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import split
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.floor import with_floors
from pzt_ros.diagnosis.grain import with_nodes
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.past_instead import _likeliest
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.parallel import IN_THIS_PROCESS
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.quadrature import Quadrature

CREEP = SlowRelaxation(share=0.03)


def stage(ceramic: Polycrystal) -> Chain:
    def instead(link: Link) -> Link:
        return ceramic if isinstance(link, Ferroelectric) else link

    return load_chain("thesis-p2").with_links(instead)


def taken_for_a_lattice(plant: Chain) -> Hypothesis:
    train, test = runs_of(plant)
    floored = with_floors((*train, *test))
    runs = split(floored[: len(train)], floored[len(train) :])
    return begun(default_chain(runs), runs)


@pytest.mark.parametrize("rule", ["thesis", "equal_probability"])
def test_a_stage_that_has_nodes_gets_them(rule: str) -> None:
    fine = taken_for_a_lattice(stage(Quadrature(**FIELDS, rule=rule)))
    found = with_nodes(fine)
    model = found.staged.ceramic.link(found.vector)
    assert isinstance(model, Quadrature)
    assert model.rule == rule
    assert max(fine.ratios) > 2.0
    assert max(found.ratios) < 1.05


@pytest.mark.parametrize("effect", [None, CREEP, MainsHum(frequency=50.0, sine=3e-8)])
def test_another_gets_none(effect: Link | None) -> None:
    """Fine as a specimen is, alone and beside effects that are missing, which leave more than the nodes are off by."""
    plant = stage(Lattice(**FIELDS, spacing=0.2))
    fine = taken_for_a_lattice(with_effect(plant, effect) if effect else plant)
    assert with_nodes(fine) is fine


@pytest.mark.long
def test_an_effect_beside_nodes_is_named() -> None:
    """A creep beside the nodes of which a lattice leaves more than twice the noise, see the first test."""
    plant = with_effect(stage(Quadrature(**FIELDS)), CREEP)
    report = diagnose(*runs_of(plant), workers=IN_THIS_PROCESS)
    assert [effect.name for effect in report.effects] == ["slow_relaxation"]
    assert report.base["model"] == "quadrature"
    assert not report.remains.present
    assert report.after.score < 1.05 * NOISE
    assert report.before.score > 1.5 * NOISE


def test_what_was_refitted_beside_a_base_is_not_refitted_again() -> None:
    base = taken_for_a_lattice(with_effect(stage(Lattice(**FIELDS)), CREEP))
    told: list[str] = []
    search = Search(Thresholds().on_undeclared(), progress=told.append)
    found = search.beside(base)
    assert any(line.startswith("refitting") for line in told)
    told.clear()
    knowing = dataclasses.replace(search, known=(base, found))
    assert {each.name: each.after.total for each in knowing.beside(base)} == {
        each.name: each.after.total for each in found
    }
    assert not any(line.startswith("refitting") for line in told)
    elsewhere = dataclasses.replace(base)  # the same, but not known to be
    assert knowing.beside(elsewhere)
    assert any(line.startswith("refitting") for line in told)


def test_a_past_is_sought_beside_what_may_hide_it() -> None:
    """Not beside what leaves far more than the best."""

    def candidate(excess: float, fit_share: float) -> Any:
        return SimpleNamespace(after=SimpleNamespace(excess=excess), fit_share=fit_share)

    hum, mode, lag = candidate(1.0, 0.99), candidate(90.0, 0.1), candidate(95.0, 0.05)
    assert _likeliest([lag, hum, mode]) == [hum]
    close = candidate(4.0, 0.96)
    assert _likeliest([close, lag, hum]) == [hum, close]
    assert _likeliest([mode, lag]) == [mode, lag]
    assert _likeliest([]) == []
