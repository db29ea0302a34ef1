"""A current limit into the ceramic, fitted by its shortcut: exact where it was asked, near by, and in the end."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.diagnosis.base import fit_declared
from pzt_ros.diagnosis.coordinates import of_effect
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.diagnose import diagnose
from pzt_ros.diagnosis.hypothesis import exact, fitted
from pzt_ros.diagnosis.refinement import taken_on
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.diagnosis.staged import Staged
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.table import EFFECT_OF
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.records import Record
from pzt_ros.sysid.predict import predict
from pzt_ros.sysid.run import Start, drive_of, free_run

NOISE, RATE = 8e-9, 500.0
KIND = "amplifier_charge_limit"
MOST = 0.7
"""Largest current over the electrodes' area [A/m^2]; fast loops ask for several times that."""


def declared() -> Chain:
    chain = load_chain("thesis-p2")
    names = [f"parametrized.{name}" for name in ("barrier_ascending", "barrier_descending", "relaxation_time")]
    return dataclasses.replace(chain, notes={"free": [*names, "electrostriction.coefficient"]})


def run(seed: int) -> Record:
    """Poling, slow legs, then loops so fast that they turn before the voltage has followed; a simulated run.

    The amplifier that limits it steps its load sample by sample, which no link of an effect does.
    """
    rng = np.random.default_rng(seed)
    legs = np.interp(np.arange(0.0, 3.0, 1.0 / RATE), [0.0, 0.5, 1.0, 1.5, 2.0, 3.0], [0, 140, 20, 120, 40, 60])
    cycle = np.arange(0.0, 1.5, 1.0 / RATE)
    loops = legs[-1] + rng.uniform(45, 60) * np.sin(2.0 * np.pi * rng.uniform(5.0, 8.0) * cycle)
    voltage = np.concatenate((legs, loops))
    time = np.arange(voltage.size) / RATE
    chain = declared()
    area = chain.links[0].electrode_area  # type: ignore[attr-defined]
    chain = dataclasses.replace(chain, links=(Amplifier(current_limit=MOST * area), *chain.links))
    _, out = chain.step(chain.init(Rest()), Signals(time=time, voltage=voltage))
    y = out.displacement + NOISE * rng.standard_normal(time.size) + rng.uniform(-1e-6, 1e-6)
    return Record(f"run-{seed}", {"time_s": time, "voltage_V": voltage, "displacement_m": y})


@pytest.fixture(scope="module")
def staged() -> Staged:
    """The declared model beside the limit, at its true value and all others as declared."""
    runs = split([RunData(run(1), {}, NOISE)], [RunData(run(2), {}, NOISE)])
    base = fit_declared(declared(), runs, lambda text: None).staged
    link = EFFECT_OF[KIND].link(inverse_current_density=1.0 / MOST)
    added = of_effect(EFFECT_OF[KIND], link, range(2))
    return dataclasses.replace(base, chain=with_effect(base.chain, link), coordinates=(*base.coordinates, *added))


def rms_off(found: Staged, vector: Array) -> float:
    """How far the displacement of the first run is from that of the chain itself [m]."""
    record = found.runs[0].record
    chain = found.chain_at(vector, 0)
    there = free_run(chain, record, Start(), slice(None), len(record)).displacement
    return float(np.std(found.outputs(vector, [0])[0][0] - there))


def test_it_is_exact_where_it_was_asked(staged: Staged) -> None:
    near = rms_off(staged, staged.start)
    assert near > NOISE  # turns that the voltage did not reach
    assert rms_off(staged.exact_at(staged.start), staged.start) < 1e-3 * NOISE


def test_near_by_it_is_off_by_far_less_than_the_shortcut(staged: Staged) -> None:
    asked = staged.exact_at(staged.start)
    limit = len(staged.start) - 1
    assert staged.coordinates[-1].kind == KIND
    for place, step in ((limit, 0.02), (0, 0.02)):
        moved = staged.start.copy()
        moved[place] += step
        assert rms_off(asked, moved) < 0.3 * rms_off(staged, moved)


def test_its_limit_is_no_link_before_the_ceramic_for_a_search(staged: Staged) -> None:
    """One pass over the ceramic serves for all limits."""
    assert not staged.is_before(KIND)
    np.testing.assert_array_equal(staged.voltages(staged.start)[0], drive_of(staged.runs[0].record).voltage)


def test_a_fit_from_elsewhere_finds_it_and_comes_down_to_the_noise(staged: Staged) -> None:
    begin = staged.start.copy()
    begin[-1] *= 1.4
    found = taken_on(exact(fitted(staged, begin, (KIND,))), Thresholds())
    link = next(link for link in found.staged.chain_at(found.vector).links if link.kind == KIND)
    assert link.inverse_current_density == pytest.approx(1.0 / MOST, rel=2e-3)  # type: ignore[attr-defined]
    assert found.fit.ratio == pytest.approx(1.0, abs=0.03)


def test_without_the_limit_nothing_is_left_of_it(staged: Staged) -> None:
    plain, kept = staged.exact_at(staged.start).without(KIND)
    assert plain.beyond == {}
    assert len(kept) == staged.start.size - 1
    assert plain.exact_at(staged.start[kept]).beyond == {}


def test_it_is_named_and_foretells_runs_that_no_fit_saw() -> None:
    report = diagnose([run(1), run(2)], [run(3)], declared())
    assert [effect.name for effect in report.effects] == ["amplifier_current_limit"]
    assert not report.remains.present
    unseen = run(4)
    assert predict(report.baseline, unseen).rms > 2.0 * NOISE
    assert predict(report.model, unseen).rms < 1.03 * NOISE
