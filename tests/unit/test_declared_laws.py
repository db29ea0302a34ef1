"""Whatever strain law a chain declares, and whichever way the sensor counts: all simulated."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.branches import _on_free_law
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.flexible import beside_the_rest
from pzt_ros.diagnosis.hypothesis import Hypothesis
from pzt_ros.diagnosis.search import Search
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_hysteresis import StrainHysteresis
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.records import Record

NOISE = 8e-9
PLAIN = load_chain("thesis-p2")
QUADRATIC = next(link.coefficient * link.active_length for link in PLAIN.links if isinstance(link, Electrostriction))


def declared(law: Link) -> Chain:
    """Thesis set P2 with another law, and both a little wrong."""
    chain = PLAIN.with_links(lambda link: law if isinstance(link, Electrostriction) else link)
    free = [
        "parametrized.relaxation_time",
        f"{law.kind}.{'coefficient' if hasattr(law, 'coefficient') else 'quadratic'}",
    ]
    return dataclasses.replace(chain, notes={"free": free})


def runs(sign: float, polarity: float = 1.0) -> list[RunData]:
    """One to fit and one to choose by and to score, of the plant with electrostriction."""
    time = np.arange(0.0, 3.0, 2e-3)
    voltage = np.interp(time, [0.0, 0.5, 1.0, 1.5, 2.0, 3.0], [0.0, 140.0, 10.0, 110.0, 40.0, 40.0])
    _, out = PLAIN.step(PLAIN.init(Rest(time=0.0)), Signals(time=time, voltage=voltage))
    found = []
    for seed in (0, 1):
        reading = sign * (out.displacement + NOISE * np.random.default_rng(seed).standard_normal(time.size))
        record = Record(f"run {seed}", {"time_s": time, "voltage_V": polarity * voltage, "displacement_m": reading})
        found.append(RunData(record, {}, NOISE))
    return split(found[:1], found[1:])


def fitted_to(law: Link, sign: float = 1.0) -> Hypothesis:
    return fit_declared(declared(law), runs(sign), lambda text: None)


def test_a_reading_that_falls_with_the_voltage_gets_a_chain_that_does() -> None:
    up, down = default_chain(runs(1.0)), default_chain(runs(-1.0))
    signals = runs(1.0)[0].signals
    ways = [chain.step(chain.init(Rest(time=0.0)), signals)[1].displacement for chain in (up, down)]
    assert ways[1] == pytest.approx(-ways[0], abs=1e-15)
    assert np.ptp(ways[0]) == pytest.approx(np.ptp(runs(1.0)[0].record.displacement), rel=1.0)


def test_a_stage_driven_to_negative_voltages_extends_as_well() -> None:
    laws = [default_chain(runs(sign, polarity)).links[-1] for sign in (1.0, -1.0) for polarity in (1.0, -1.0)]
    assert [isinstance(law, StrainLaw) for law in laws] == [False, False, True, True]


def test_a_law_that_falls_fits_as_well_as_one_that_rises() -> None:
    rises = fitted_to(Electrostriction(coefficient=0.9 * QUADRATIC / 8e-3, active_length=8e-3))
    falls = fitted_to(StrainLaw(quadratic=-0.9 * QUADRATIC), sign=-1.0)
    assert rises.fit.ratio == pytest.approx(1.0, abs=0.03)
    assert falls.fit.ratio == pytest.approx(rises.fit.ratio, abs=1e-3)
    law = next(link for link in falls.staged.chain_at(falls.vector).links if isinstance(link, StrainLaw))
    assert law.quadratic == pytest.approx(-QUADRATIC, rel=0.02)


@pytest.mark.parametrize(
    ("law", "kinds"),
    [
        (Electrostriction(), ["parametrized", "strain_law"]),
        (StrainLaw(), ["parametrized", "strain_law"]),
        (StrainHysteresis(polarization_lead=0.0), ["parametrized", "strain_law"]),
        (StrainHysteresis(polarization_lead=0.01), ["parametrized", "strain_polarization_hysteresis", "strain_law"]),
    ],
    ids=["electrostriction", "strain law", "no lead", "lead"],
)
def test_another_law_stands_in_place_of_whatever_was_declared(law: Link, kinds: list[str]) -> None:
    """A declared strain law stayed beside another ceramic, with coordinates of the one that was fitted to that."""
    before = fitted_to(law)
    new = StrainLaw(linear=2e-6, quadratic=1e-4)
    staged, start = beside_the_rest(before, before.staged.ceramic, new, 2)
    assert [link.kind for link in staged.chain.links if link.kind in (*kinds, law.kind)] == kinds
    assert new in staged.chain.links
    names = [each.name for each in staged.coordinates]
    lead = [f"strain_polarization_hysteresis.{field}" for field in ("polarization_lead", "turn_width")]
    assert names == ["strain_law.linear", "strain_law.quadratic", *(lead if len(kinds) > 2 else [])]
    assert start.size == staged.start.size
    moved = start.copy()
    moved[staged.ceramic.start.size] *= 1.1
    (displacement, _), (other, _) = (staged.outputs(vector, [0])[0] for vector in (start, moved))
    assert np.ptp(other - displacement) > 1e-8


CURVED = StrainLaw(linear=2e-6, quadratic=0.9 * QUADRATIC, cubic=8e-5)


def curved_runs(hum: float = 0.0) -> list[RunData]:
    """Of the plant with a strain law that no chain declares, and hum on the voltage's reading [m]."""
    plant = PLAIN.with_links(lambda link: CURVED if isinstance(link, Electrostriction) else link)
    return [
        dataclasses.replace(run, record=_read(run, plant, hum, seed)) for seed, run in enumerate(runs(1.0), start=2)
    ]


def _read(run: RunData, plant: Chain, hum: float, seed: int) -> Record:
    signals = run.signals
    _, out = plant.step(plant.init(Rest(time=0.0)), signals)
    noise = NOISE * np.random.default_rng(seed).standard_normal(signals.time.size)
    wave = hum * np.sin(2.0 * np.pi * 50.0 * signals.time)
    return Record(f"curved {seed}", {**run.record.columns, "displacement_m": out.displacement + noise + wave})


def test_an_effect_is_found_beside_another_strain_law_than_was_declared() -> None:
    """Beside the declared law it is named as well, but something else is left; beside a free one nothing is."""
    chain = declared(Electrostriction(coefficient=QUADRATIC / 8e-3, active_length=8e-3))
    found = fit_declared(chain, curved_runs(3e-8), lambda text: None)
    search = Search(effects=(EFFECT_OF["mains_hum"],))
    steps = search.run(found)
    assert max(steps[-1].after.ratios) > 1.1
    branch = _on_free_law(found, steps, search)
    assert branch is not None
    assert branch.has_free_law
    assert branch.final.effects == ("mains_hum",)
    assert max(branch.final.ratios) < 1.05
    law = next(link for link in branch.final.staged.chain_at(branch.final.vector).links if isinstance(link, StrainLaw))
    signals = curved_runs()[0].signals
    plant = PLAIN.with_links(lambda link: CURVED if isinstance(link, Electrostriction) else link)
    p = plant.step(plant.init(Rest(time=0.0)), signals)[1].polarization
    there, truth = (each.linear * p + each.quadratic * p**2 + each.cubic * p**3 for each in (law, CURVED))
    assert np.std(there - truth) < 0.02 * np.std(truth)


def test_a_declared_strain_law_that_holds_is_not_freed() -> None:
    found = fitted_to(Electrostriction(coefficient=0.9 * QUADRATIC / 8e-3, active_length=8e-3))
    search = Search(effects=(EFFECT_OF["mains_hum"],))
    assert _on_free_law(found, search.run(found), search) is None
