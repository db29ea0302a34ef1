"""Effects of the ceramic and the polynomial strain law, against closed solutions and a second way."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.effects.bias_field import BiasField
from pzt_ros.effects.insert import with_effect
from pzt_ros.effects.leakage import Leakage
from pzt_ros.effects.polarization_fatigue import PolarizationFatigue
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.effects.strain_polarization_lag import StrainPolarizationLag
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import AMPLIFIER, Link
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_hysteresis import StrainHysteresis
from pzt_ros.physics.strain_law import StrainLaw


def triangle(*turns: float, per_leg: int = 200) -> Array:
    """Straight lines through the turns."""
    legs = [np.linspace(a, b, per_leg, endpoint=False) for a, b in itertools.pairwise(turns)]
    return np.concatenate([*legs, [turns[-1]]])


def stepped(link: Link, signals: Signals) -> Signals:
    return link.step(link.init(Rest()), signals)[1]


def of_polarization(polarization: Array) -> Signals:
    return Signals(np.arange(polarization.size) * 1e-3, polarization=polarization)


def tired(link: PolarizationFatigue, polarization: Array) -> Array:
    return stepped(link, of_polarization(polarization)).polarization


def test_each_cycle_loses_the_same() -> None:
    """After n cycles between -P_r and P_r, 1 - n loss is left, but for the 1/400 of a cycle since the last sample."""
    link = PolarizationFatigue(loss=2e-3, reference_polarization=0.25)
    peaks = tired(link, triangle(*([0.25, -0.25] * 30), 0.25))[:: 2 * 200]
    counted = np.maximum(np.arange(31) - 1 / 400, 0.0)
    np.testing.assert_allclose(peaks, 0.25 * (1 - 2e-3 * counted), rtol=1e-12)


def test_a_run_that_goes_on_after_another_counts_on() -> None:
    """The cycles before are a parameter: the two halves of a run are the run."""
    polarization = triangle(*([0.2, -0.1] * 8), 0.2)
    first, second = polarization[:1500], polarization[1499:]
    before = np.sum(np.abs(np.diff(first))) / (4 * 0.25)
    halves = (
        tired(PolarizationFatigue(loss=1e-2, exponent=0.7, cycles_before=n), p)
        for n, p in ((0.0, first), (before, second))
    )
    whole = tired(PolarizationFatigue(loss=1e-2, exponent=0.7), polarization)
    joined = np.concatenate([next(halves), next(halves)[1:]])
    np.testing.assert_allclose(joined[1501:], whole[1501:], rtol=1e-12)


def test_fatigue_stands_still_in_a_pause_and_takes_power_laws() -> None:
    link = PolarizationFatigue(loss=1e-2, exponent=0.5, reference_polarization=0.1)
    cycle = triangle(0.1, -0.1, 0.1)
    with_pause = np.concatenate([cycle, np.full(5000, 0.1), triangle(*([0.1, -0.1] * 8), 0.1)])
    found = tired(link, with_pause)
    assert found[len(cycle)] == pytest.approx(0.1 * (1 - 1e-2), rel=1e-12)
    np.testing.assert_array_equal(found[len(cycle) : len(cycle) + 5000], found[len(cycle)])
    assert found[-1] == pytest.approx(0.1 * (1 - 1e-2 * 3.0), rel=1e-4)  # the root of 9 cycles


def test_what_is_left_never_changes_its_sign() -> None:
    found = tired(PolarizationFatigue(loss=0.5), triangle(*([0.25, -0.25] * 10), 0.25))
    assert found[-1] > 0.0


def test_bias_moves_the_loop_along_the_voltage() -> None:
    """A constant bias is the same loop at another voltage, and the amplifier's voltage does not know of it."""
    chain = load_chain("bench-stage")
    time = np.arange(400) * 1e-3
    drive = Signals(time, voltage=60.0 + 60.0 * np.sin(20 * time))
    with_bias = with_effect(chain, BiasField(bias_voltage=7.0))
    behind, behind_with_bias = chain.behind_amplifier, with_bias.behind_amplifier
    shifted = drive.replace(voltage=drive.voltage - 7.0)
    rest = Rest(time=0.0, voltage=53.0)
    one = behind.step(behind.init(rest), shifted)[1]
    other = behind_with_bias.step(behind_with_bias.init(rest), drive)[1]
    np.testing.assert_array_equal(other.displacement, one.displacement)
    np.testing.assert_array_equal(other.polarization, one.polarization)
    amplifier, same = chain.section(AMPLIFIER), with_bias.section(AMPLIFIER)
    applied, also = (a.step(a.init(Rest()), drive)[1].voltage for a in (amplifier, same))
    np.testing.assert_array_equal(applied, also)


def test_bias_builds_up_from_the_first_sample_on() -> None:
    time = 1.7e3 + np.linspace(0.0, 500.0, 200)
    link = BiasField(bias_voltage=2.0, drift_share=0.75, time_constant=80.0)
    found = stepped(link, Signals(time, voltage=np.full(200, 50.0))).voltage
    np.testing.assert_allclose(found, 50.0 - 0.5 - 1.5 * (1 - np.exp(-(time - 1.7e3) / 80.0)), rtol=0, atol=1e-12)


def test_leakage_is_charge_through_a_resistor() -> None:
    time = np.cumsum(np.random.default_rng(1).exponential(0.1, 300))
    voltage = np.where(time < 10.0, 100.0, -40.0)
    signals = Signals(time, voltage=voltage, polarization=np.full(300, 0.2), displacement=np.ones(300))
    out = stepped(Leakage(areal_conductance=1e-6), signals)
    np.testing.assert_allclose(out.polarization[time < 10.0], 0.2 + 1e-4 * (time[time < 10.0] - time[0]), rtol=1e-12)
    charge = np.concatenate(([0.0], np.cumsum(0.5 * (voltage[1:] + voltage[:-1]) * np.diff(time))))
    np.testing.assert_allclose(out.polarization, 0.2 + 1e-6 * charge, rtol=1e-12)
    np.testing.assert_array_equal(out.displacement, signals.displacement)


def test_leakage_moves_the_recorded_polarization_and_nothing_else() -> None:
    chain = load_chain("thesis-p1")
    time = np.linspace(0.0, 5.0, 300)
    drive = Signals(time, voltage=75.0 - 75.0 * np.cos(3 * time))
    leaky = with_effect(chain, Leakage(areal_conductance=1e-4))
    one, other = (c.step(c.init(Rest()), drive)[1] for c in (chain, leaky))
    np.testing.assert_array_equal(one.displacement, other.displacement)
    assert other.polarization[-1] - one.polarization[-1] == pytest.approx(1e-4 * np.trapezoid(drive.voltage, time))


def test_hysteresis_before_electrostriction_is_the_strain_hysteresis_link() -> None:
    polarization = triangle(0.1, 0.3, -0.3, 0.1, -0.2, 0.3)
    shape = {"polarization_lead": 0.03, "turn_width": 0.08}
    pair = Chain("pair", (StrainPolarizationHysteresis(**shape), Electrostriction()))
    _, out = pair.step(pair.init(Rest()), of_polarization(polarization))
    one = stepped(StrainHysteresis(**shape), of_polarization(polarization))
    np.testing.assert_allclose(out.displacement, one.displacement, rtol=0, atol=1e-19)
    np.testing.assert_array_equal(out.polarization, polarization)  # what charge measures


def test_hysteresis_of_several_widths_is_the_mean_of_one_each() -> None:
    polarization = triangle(0.1, 0.3, -0.3, 0.1, -0.2, 0.3)
    spread = StrainPolarizationHysteresis(polarization_lead=0.03, turn_width=0.08, spread_below=0.9, spread_above=0.6)
    of_one = [
        stepped(StrainPolarizationHysteresis(polarization_lead=0.03, turn_width=width), of_polarization(polarization))
        for width in (0.08 * math.exp(-0.9), 0.08, 0.08 * math.exp(0.6))
    ]
    found = stepped(spread, of_polarization(polarization)).straining
    np.testing.assert_allclose(found, np.mean([out.straining for out in of_one], axis=0), rtol=0, atol=1e-15)


@pytest.mark.parametrize("spread", [0.0, 0.6, 2.0])
@pytest.mark.parametrize("strain", [Electrostriction(), StrainLaw(linear=2e-6, cubic=4e-5)])
def test_inverse_of_the_pair_gives_the_polarization_back(strain: Link, spread: float) -> None:
    link = StrainPolarizationHysteresis(
        polarization_lead=0.02, turn_width=0.05, spread_below=spread, spread_above=0.5 * spread
    )
    pair = Chain("pair", (link, strain))
    polarization = triangle(0.1, 0.3, 0.05, 0.25, 0.22, 0.24, 0.1)
    _, out = pair.step(pair.init(Rest()), of_polarization(polarization))
    _, back = pair.invert(pair.init(Rest()), Signals(out.time, displacement=out.displacement))
    np.testing.assert_allclose(back.polarization, polarization, rtol=0, atol=1e-13)


def test_strain_that_lags_follows_a_share_of_a_play() -> None:
    """An examiner's hysteresis between strain and polarization, of the other sign than the thesis saw."""
    polarization = triangle(0.0, 0.3, 0.05, 0.25, 0.22, 0.24, 0.1)
    link = StrainPolarizationLag(lagging_share=0.15, play=0.012)
    held, played = 0.0, []
    for value in polarization:
        held = min(max(held, value - 0.012), value + 0.012)
        played.append(held)
    straining = stepped(link, of_polarization(polarization)).straining
    np.testing.assert_allclose(straining, 0.85 * polarization + 0.15 * np.array(played), rtol=0, atol=1e-15)
    _, back = link.invert(link.init(Rest()), Signals(np.arange(straining.size) * 1.0, strain_polarization=straining))
    np.testing.assert_allclose(back.polarization, polarization, rtol=0, atol=1e-13)


LAW = StrainLaw(linear=3e-6, quadratic=1.5e-4, cubic=-8e-5, field=4e-8)


def test_quadratic_strain_law_is_electrostriction() -> None:
    polarization = triangle(0.0, 0.3, -0.3, 0.1)
    plain = Electrostriction(coefficient=0.02, active_length=8e-3)
    same = StrainLaw(quadratic=0.02 * 8e-3)
    one, other = (stepped(link, of_polarization(polarization)) for link in (plain, same))
    np.testing.assert_allclose(other.displacement, one.displacement, rtol=1e-14)


def test_strain_law_is_its_polynomial() -> None:
    polarization, voltage = np.linspace(-0.3, 0.3, 41), np.linspace(-50.0, 150.0, 41)
    out = stepped(LAW, of_polarization(polarization).replace(voltage=voltage))
    expected = np.polyval([-8e-5, 1.5e-4, 3e-6, 0.0], polarization) + 4e-8 * polarization * voltage
    np.testing.assert_allclose(out.displacement, expected, rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize(
    ("law", "low", "high"),
    [
        (LAW, 0.0, 0.5),
        (LAW, -0.5, -0.06),
        (StrainLaw(linear=0.0), 0.0, 0.5),
        (StrainLaw(linear=0.0), -0.5, 0.0),
        (StrainLaw(quadratic=-2e-4), 0.0, 0.4),
        (StrainLaw(quadratic=0.0, linear=1e-5), -0.4, 0.4),
        (StrainLaw(linear=1e-5, quadratic=0.0, cubic=1e-4), -0.4, 0.4),
        (StrainLaw(linear=-1e-5, quadratic=1e-4, cubic=1e-4), 0.1, 0.4),
    ],
)
def test_inverse_of_the_strain_law_on_its_branch(law: StrainLaw, low: float, high: float) -> None:
    """From the branch that the last polarization was on, over the whole of it."""
    voltage = np.full(301, 20.0)
    polarization = triangle(0.5 * (low + high), high, low, 0.5 * (low + high), per_leg=100)
    signals = of_polarization(polarization).replace(voltage=voltage)
    state, _ = law.step(law.init(Rest()), signals)
    _, back = law.invert(state, stepped(law, signals).replace(polarization=np.empty(0)))
    end = np.isclose(polarization, low) & (low * high == 0.0)  # at a turning point a root has half the digits
    np.testing.assert_allclose(back.polarization[~end], polarization[~end], rtol=0, atol=1e-11)
    np.testing.assert_allclose(back.polarization[end], polarization[end], rtol=0, atol=1e-7)


def test_inverse_of_the_strain_law_finds_roots_as_numpy_does() -> None:
    wanted = np.linspace(1e-7, 6e-6, 30)
    _, back = LAW.invert(LAW.init(Rest()), Signals(np.arange(30.0), displacement=wanted))
    for y, p in zip(wanted, back.polarization, strict=True):
        roots = np.roots([-8e-5, 1.5e-4, 3e-6, -y])
        real = roots[np.abs(roots.imag) < 1e-12].real
        assert np.min(np.abs(real - p)) < 1e-12
        assert -0.01 < p < 1.2599  # between the turning points


def test_displacement_beyond_the_branch_gives_its_end() -> None:
    law = StrainLaw(linear=-2e-5, quadratic=1e-4)  # least at P = 0.1, -1e-6 m
    _, back = law.invert(law.init(Rest()), Signals(np.arange(3.0), displacement=np.array([0.0, -2e-6, 0.0])))
    np.testing.assert_allclose(back.polarization, [0.2, 0.1, 0.2], rtol=0, atol=1e-9)


def test_cross_term_takes_the_last_voltage_where_none_is_known() -> None:
    """On the way back from a displacement the voltage comes last; after a few samples of feedback it is known."""
    before = of_polarization(np.array([0.15, 0.2])).replace(voltage=np.array([80.0, 100.0]))
    state, out = LAW.step(LAW.init(Rest()), before)
    _, back = LAW.invert(state, Signals(np.array([1.0]), displacement=out.displacement[-1:]))
    assert back.polarization[0] == pytest.approx(0.2, abs=1e-14)
