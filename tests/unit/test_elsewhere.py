"""A hysteresis of the strain refitted with one width and from three well apart; it is made of plays of this file.

All runs are simulated.
"""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from pzt_benchmarks.residual_court.cases import Spec
from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.elsewhere import from_elsewhere
from pzt_ros.diagnosis.flexible import fit_rate_independent
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.screen import Screen
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.records import Record
from tests.unit.test_elements_beside import declared_of, quiet

NOISE, RATE = 8e-9, 500.0
LEAD, WIDTH = 0.01, 0.04
KIND = StrainPolarizationHysteresis.kind


def declared() -> Chain:
    """Thesis set P2, its density and its law known."""
    return dataclasses.replace(load_chain("thesis-p2"), notes={"free": ["electrostriction.coefficient"]})


def ahead(polarization: Array, plays: tuple[float, ...]) -> Array:
    """Polarization less plays behind it, of widths in units of WIDTH [C/m^2]."""
    out = polarization.copy()
    for factor in plays:
        y, radius = float(polarization[0]), 0.5 * factor * WIDTH
        for k, p in enumerate(polarization):
            y = min(max(y, p - radius), p + radius)
            out[k] += LEAD * (p - y) / radius / len(plays)
    return out


def run(seed: int, plays: tuple[float, ...]) -> RunData:
    """Reversals at random, the strain ahead of the polarization."""
    rng = np.random.default_rng(seed)
    volts = [0.0, 140.0, *(v for _ in range(8) for v in (rng.uniform(0, 60), rng.uniform(70, 140)))]
    time = np.arange(0.0, 0.5 * (len(volts) - 1), 1.0 / RATE)
    voltage = np.interp(time, 0.5 * np.arange(len(volts)), volts)
    *before, strain = declared().links
    signals = Signals(time=time, voltage=voltage)
    for link in before:
        _, signals = link.step(link.init(Rest(time=0.0)), signals)
    leading = signals.replace(strain_polarization=ahead(signals.polarization, plays))
    _, out = strain.step(strain.init(Rest(time=0.0)), leading)
    y = out.displacement + NOISE * rng.standard_normal(time.size)
    return RunData(Record(f"run-{seed}", {"time_s": time, "voltage_V": voltage, "displacement_m": y}), {}, NOISE)


def begun_at(base: Hypothesis, scale: float, spreads: tuple[float, float]) -> Hypothesis:
    """As a search would have ended there."""
    link = StrainPolarizationHysteresis(
        polarization_lead=scale * LEAD, turn_width=scale * WIDTH, spread_below=spreads[0], spread_above=spreads[1]
    )
    prospect = Screen(base)._prospect(EFFECT_OF[KIND], link)
    return fitted(prospect.staged, prospect.best_start(), (KIND,), 0)


def found_in(hypothesis: Hypothesis) -> StrainPolarizationHysteresis:
    chain = hypothesis.staged.chain_at(hypothesis.vector)
    (link,) = [link for link in chain.links if isinstance(link, StrainPolarizationHysteresis)]
    return link


def hypothesis(plays: tuple[float, ...]) -> Hypothesis:
    """The declared model fitted to one run."""
    return fit_declared(declared(), split([run(1, plays)], [run(3, plays)]), lambda text: None)


def test_one_play_is_not_left_as_three() -> None:
    begun = begun_at(hypothesis((1.0,)), 1.0, (0.4, 0.3))
    found = from_elsewhere(begun, Thresholds())
    link = found_in(found)
    assert (link.spread_below, link.spread_above) == (0.0, 0.0)
    assert not [each for each in found.staged.coordinates if each.field.startswith("spread")]
    assert link.turn_width == pytest.approx(WIDTH, rel=0.02)
    assert max(found.ratios) < 1.05 < max(begun.ratios)


def test_three_plays_are_not_left_as_two() -> None:
    """A court case: of the right three widths a density took the place, and the third was more than twice as wide."""
    begun = begun_at(hypothesis((0.4, 1.0, 1.8)), 0.6, (0.0, 0.9))
    found = from_elsewhere(begun, Thresholds())
    link = found_in(found)
    assert link.turn_width == pytest.approx(WIDTH, rel=0.05)
    assert link.polarization_lead == pytest.approx(LEAD, rel=0.05)
    assert link.turn_width * np.exp(-link.spread_below) == pytest.approx(0.4 * WIDTH, rel=0.1)
    assert link.turn_width * np.exp(link.spread_above) == pytest.approx(1.8 * WIDTH, rel=0.2)
    assert found.total < 0.1 * begun.total


def test_what_has_no_widths_is_left_as_it_is() -> None:
    begun = hypothesis((1.0,))
    assert from_elsewhere(begun, Thresholds()) is begun
    plain = from_elsewhere(begun_at(begun, 1.0, (0.4, 0.3)), Thresholds())
    assert from_elsewhere(plain, Thresholds()) is plain


@pytest.mark.long
@pytest.mark.parametrize(("family", "seed"), [("play_sum", 4), ("wedge_preisach", 3)])
def test_relays_that_have_bent_for_it_find_a_hysteresis_of_the_strain(family: str, seed: int, tmp_path: Path) -> None:
    """Of court stages with one of 10 x, from where a screen begins 2.0 and 2.3 x the noise were left."""
    relays = fit_rate_independent(
        declared_of(Spec("effect_wrong", family, (KIND,), 10.0, "short", seed=seed), tmp_path), quiet
    )
    identify = partial(fit_rate_independent, progress=quiet)
    search = Search(effects=(EFFECT_OF[KIND],), identify=identify, is_at_bottom=True)
    (found,) = search.step(relays).candidates
    assert max(relays.ratios) > 2.5
    assert max(found.after.ratios) < 1.04


def test_relays_on_fewer_cells_are_the_same_density() -> None:
    time = np.arange(0.0, 4.0, 1.0 / RATE)
    voltage = 70.0 - 70.0 * np.cos(2.0 * np.pi * time) * np.exp(-0.2 * time)
    many = FlexiblePreisach([time], 1e-4, (0.0, 1.4e6), resolution=30, initial="virgin", total=0.26)
    few, vector = many.on_cells(10, many.start)
    assert few.interaction[[0, -1]].tolist() == many.interaction[[0, -1]].tolist()  # or none has its weight
    assert few.start.size < 0.2 * many.start.size
    (fine,), (coarse,) = many.polarization(many.start, [voltage]), few.polarization(vector, [voltage])
    assert np.ptp(coarse) == pytest.approx(np.ptp(fine), rel=0.05)
    assert np.max(np.abs(coarse - coarse.mean() - fine + fine.mean())) < 0.05 * np.ptp(fine)
