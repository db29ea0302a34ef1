"""Relays that know no rate, of runs that begin inside minor loops which nobody recorded: simulated by sums of plays."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from pzt_ros.diagnosis.base import begun
from pzt_ros.diagnosis.data import RunData, split
from pzt_ros.diagnosis.flexible import fit_rate_independent
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.histories import renewed
from pzt_ros.diagnosis.hypothesis import Hypothesis, fitted
from pzt_ros.diagnosis.less_effects import ceramic_alone
from pzt_ros.diagnosis.parts import wiped_out
from pzt_ros.diagnosis.undeclared import default_chain
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.thermal_drift import ThermalDrift
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.preisach import Preisach
from pzt_ros.physics.signals import Array
from pzt_ros.physics.strain_law import StrainLaw
from pzt_ros.records import Record
from pzt_ros.sysid.identified_problem import MeasuredRun
from pzt_ros.sysid.rate_independent import RateIndependentHysteresis
from pzt_ros.sysid.run import Start
from pzt_ros.sysid.start import CountedPart, displacement_of, turning_part

RATE, NOISE = 200.0, 10e-9
PASTS = (150.0, -10.0, 95.0, 20.0), (150.0, 30.0, 110.0), (150.0, 0.0)


def path(points: list[float], rate: float) -> Array:
    """Straight from one voltage to the next [V], at so many volts a second."""
    legs = [np.linspace(a, b, max(int(abs(b - a) / rate * RATE), 2))[:-1] for a, b in pairwise(points)]
    return np.concatenate([*legs, [points[-1]]])


def plays(voltage: Array) -> Array:
    """Displacement of a sum of plays whose weights fall with their widths [m]; the first sample is at rest."""
    radii = np.linspace(2.0, 70.0, 30)
    state, out = np.zeros(radii.size), np.empty(voltage.size)
    weights = np.exp(-radii / 30.0)
    for k, volt in enumerate(voltage):
        state = np.maximum(volt - radii, np.minimum(volt + radii, state))
        out[k] = weights @ state + 3.0 * volt
    return np.asarray(9e-6 * out / 1500.0)


def run(number: int, seed: int) -> Record:
    """One that follows a past of its own, which is not recorded."""
    rng = np.random.default_rng(seed)
    begin = {0: 60.0, 1: 70.0, 2: 45.0}[number]
    turns = [
        begin,
        *(float(v) for v in rng.uniform(0.0, 130.0, 9)),
        140.0,
        -8.0,
        *(float(v) for v in rng.uniform(0, 130, 8)),
    ]
    hidden, shown = path([0.0, *PASTS[number], begin], 100.0), path(turns, 80.0)
    reading = plays(np.concatenate((hidden[:-1], shown)))[hidden.size - 1 :]
    reading = reading + NOISE * rng.standard_normal(reading.size) + rng.uniform(-1e-6, 1e-6)
    return Record(
        f"run-{number}", {"time_s": np.arange(shown.size) / RATE, "voltage_V": shown, "displacement_m": reading}
    )


@pytest.fixture(scope="module")
def model() -> Hypothesis:
    """What stands for a stage of which nothing was declared, fitted as if every run began at rest."""
    runs = split([RunData(run(0, 1), {}, NOISE), RunData(run(1, 2), {}, NOISE)], [RunData(run(2, 3), {}, NOISE)])
    return begun(default_chain(runs), runs)


@pytest.fixture(scope="module")
def relays(model: Hypothesis) -> Hypothesis:
    return fit_rate_independent(model, lambda text: None)


def test_density_and_pasts_are_found_together(model: Hypothesis, relays: Hypothesis) -> None:
    assert all(each.begins_driven for each in relays.staged.runs)
    assert min(model.ratios) > 5.0
    assert max(relays.ratios) < 1.1
    pasts = [relays.staged.ceramic.start_of(relays.vector, number).prior_voltages for number in range(2)]
    assert all(pasts)
    assert pasts[0][-1] == pytest.approx(PASTS[0][-1], abs=6.0)  # the last reversals are remembered best
    assert pasts[1][-1] == pytest.approx(PASTS[1][-1], abs=6.0)


def test_pasts_are_sought_once_beside_the_same_effects(relays: Hypothesis) -> None:
    assert renewed(relays) is relays
    ceramic = relays.staged.ceramic
    assert isinstance(ceramic, FlexiblePreisach)
    lost = ceramic.with_starts([Start()] * 3)
    lost.sought_beside = None
    found = renewed(fitted(replace(relays.staged, ceramic=lost), relays.vector, most_steps=0))
    assert max(found.ratios) < 1.1


def test_a_past_is_what_was_driven_before(relays: Hypothesis) -> None:
    """Against the same drive with its past recorded, in one run."""
    past, shown = np.array(PASTS[0]), run(0, 1).voltage
    span = (-0.2e6, 1.6e6)
    voltage = np.append(past, shown)
    whole = RateIndependentHysteresis([np.arange(voltage.size) / RATE], 1e-4, span, unknown_start=[False])
    late = RateIndependentHysteresis([np.arange(shown.size) / RATE], 1e-4, span, unknown_start=[False])
    late.before = [past]
    expected, columns = whole.tangent(whole.start, [voltage])
    found, late_columns = late.tangent(late.start, [shown])
    np.testing.assert_allclose(found[0], expected[0][past.size :], atol=1e-12)
    np.testing.assert_allclose(late_columns[0], columns[0][past.size :], atol=1e-6)
    bare = RateIndependentHysteresis([np.arange(shown.size) / RATE], 1e-4, span, unknown_start=[False])
    assert np.max(np.abs(bare.polarization(bare.start, [shown])[0] - found[0])) > 1e-3


def test_only_turns_and_counted_samples_are_passed() -> None:
    record = run(0, 1)
    chain = Chain("relays", (Preisach(), StrainLaw(linear=1e-7, quadratic=1e-5)), {})
    picks = np.arange(3, 700, 9)
    part = CountedPart(record, picks, int(picks[-1]) + 1)
    fewer = turning_part(part)
    assert len(fewer.record) < 0.2 * part.end
    past = Start(PASTS[0], 1.0)
    np.testing.assert_allclose(displacement_of(chain, fewer, past), displacement_of(chain, part, past), rtol=1e-12)


def test_samples_that_no_past_reaches_come_after_both_ends() -> None:
    record = run(0, 1)
    counted = np.ones(len(record), dtype=bool)
    whole = MeasuredRun(record.time, record.voltage, record.displacement, NOISE, counted, False)
    late = wiped_out(([whole], []))[0][0]
    first = int(np.argmax(late.counted))
    assert first == max(int(np.argmin(record.voltage)), int(np.argmax(record.voltage)))
    early = whole.part(np.arange(counted.size) < first)
    assert wiped_out(([], [early.part(early.counted)]))[1][0].counted.any()  # few would be left: it stays as it is


@pytest.mark.parametrize("link", [ThermalDrift(rate=30e-9), BiasField(bias_voltage=4.0)])
def test_what_effects_do_is_taken_out_of_runs_of_the_ceramic_alone(relays: Hypothesis, link: ThermalDrift) -> None:
    """It is as far from those as the whole from its own: what a search for pasts looks at then."""
    staged = replace(relays.staged, chain=with_effect(relays.staged.chain, link))
    beside = fitted(staged, relays.vector, (link.kind,), most_steps=0)
    alone = ceramic_alone(beside)
    assert alone.effects == ()
    assert alone.ratios == pytest.approx(beside.ratios, rel=1e-6)
    assert beside.ratios != pytest.approx(relays.ratios, rel=1e-2)
