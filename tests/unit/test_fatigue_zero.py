"""Fatigue where P counts from anywhere: an identified density has its zero where its weights happen to put it."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import Spec
from pzt_ros.diagnosis.flexible import beside_the_rest, fit_rate_independent
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.search import Search
from pzt_ros.effects.polarization_fatigue import PolarizationFatigue
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.change import Change
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain_law import StrainLaw
from tests.unit.test_elements_beside import declared_of, quiet
from tests.unit.test_fatigue_goes_on import repaired

REMANENT = 0.15
LINK = PolarizationFatigue(loss=0.02, saturation_cycles=5.0, remanent_polarization=REMANENT)


def polarization() -> Array:
    found: Array = np.interp(np.arange(3000.0), np.arange(0.0, 3001.0, 250.0), np.tile([0.1, -0.12, 0.2], 5)[:13])
    return found


def of_polarization(values: Array) -> Signals:
    return Signals(np.arange(values.size) * 1e-3, polarization=values)


def tired(link: PolarizationFatigue, values: Array) -> Array:
    return link.step(link.init(Rest()), of_polarization(values))[1].polarization


def test_what_is_lost_does_not_hang_on_where_p_counts_from() -> None:
    whole = dataclasses.replace(LINK, remanent_polarization=0.0)
    expected = tired(whole, polarization() + REMANENT) - REMANENT
    np.testing.assert_allclose(tired(LINK, polarization()), expected, rtol=0.0, atol=1e-15)
    assert np.max(np.abs(expected - tired(whole, polarization()))) > 1e-3


def test_it_is_undone_to_the_digit() -> None:
    wanted = of_polarization(tired(LINK, polarization()))
    np.testing.assert_allclose(
        LINK.invert(LINK.init(Rest()), wanted)[1].polarization, polarization(), rtol=0.0, atol=1e-14
    )


def test_its_tangent_is_that_of_differences() -> None:
    values, step = polarization(), 1e-7
    columns = np.column_stack([values**2, np.sin(np.arange(values.size) / 90.0)])
    carried = LINK.carry(of_polarization(values), Change(polarization=columns)).polarization
    for k in range(2):
        ahead, behind = (tired(LINK, values + way * step * columns[:, k]) for way in (1.0, -1.0))
        np.testing.assert_allclose(carried[:, k], (ahead - behind) / (2.0 * step), rtol=0.0, atol=1e-6)


def test_another_ceramic_keeps_what_is_lost() -> None:
    """Beside relays whose zero is elsewhere, the remanent polarization moves by as much, and stays free."""
    found = repaired(goes_on=True)[1]
    times = [run.record.time for run in found.staged.runs]
    relays = FlexiblePreisach(times, 1e-4, (-0.3e6, 1.5e6), resolution=8, initial="down", total=0.26)
    staged, start = beside_the_rest(found, relays, StrainLaw(linear=1e-5), 2)
    was, now = found.staged.polarizations(found.vector)[0][0], staged.polarizations(start)[0][0]
    link = next(each for each in staged.chain_at(start).links if isinstance(each, PolarizationFatigue))
    assert abs(now - was) > 0.05
    assert link.remanent_polarization == pytest.approx(was - now, abs=1e-12)
    zeros = [each for each in staged.coordinates if each.field == EFFECT_OF[link.kind].zero]
    assert [each.kind for each in zeros] == [link.kind]
    again, there = beside_the_rest(dataclasses.replace(found, staged=staged, vector=start), relays, StrainLaw(), 2)
    assert [each.name for each in again.coordinates].count(zeros[0].name) == 1
    link = next(each for each in again.chain_at(there).links if isinstance(each, PolarizationFatigue))
    assert link.remanent_polarization == pytest.approx(was - now, abs=1e-12)


def test_plays_that_tire_come_down_to_the_noise(tmp_path: Path) -> None:
    """A court case: on relays that count P from a third of its span below, a drift was named beside the fatigue."""
    spec = Spec("effect_wrong", "play_sum", ("polarization_fatigue",), 10.0, "slow", seed=3)
    relays = fit_rate_independent(declared_of(spec, tmp_path), quiet)
    identify = partial(fit_rate_independent, progress=quiet)
    search = Search(effects=(EFFECT_OF[PolarizationFatigue.kind],), identify=identify, is_at_bottom=True)
    (found,) = search.step(relays).candidates
    assert max(relays.ratios) > 4.0
    assert max(found.after.ratios) < 1.06
