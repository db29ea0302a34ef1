"""The front model against the lattice, which solves the same physics domain by domain, and its tables against SciPy."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numba import njit
from scipy import integrate, special

from pzt_ros.errors import BenchError
from pzt_ros.physics import front_memory as kernel
from pzt_ros.physics.density import Gaussian, Table
from pzt_ros.physics.front import Front
from pzt_ros.physics.front_kinetics import LAST, _piece, attempts, front_table
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, UPPER, everett
from pzt_ros.physics.kinds import Kind
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameters_of

FRONT = Front()
LEGS = [0, 2, -2, 2, -1, 1, -0.7, 0.7, -2, 0.4, -0.2, 0.8, 0.2, 1.2, 0.5, 2, -0.4, 0.2, -0.8, -0.2, -1.2]
"""Twenty legs with nested and biased loops that close singly and together [MV/m] (reference/README.md, P3)."""

NARROW = {"coercive_field_spread": 1e10, "interaction_field_spread": 1e10}


def drive(legs: list[float], rate: float, samples: int = 700, hold: float = 0.0) -> Signals:
    """Ramps through `legs` [MV/m] at `rate` [V/m/s], then a hold [s] sampled ever more sparsely."""
    turns = np.array(legs) * 1e6
    time = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(turns)) / rate)))
    at = np.union1d(np.linspace(0, time[-1], samples)[1:], time[1:])
    field = np.interp(at, time, turns)
    if hold:
        later = np.geomspace(1e-4, hold, 40)
        at, field = np.concatenate((at, at[-1] + later)), np.concatenate((field, np.full(40, field[-1])))
    return Signals(time=at, voltage=field * 1e-4)


def multisine(highest: float, samples: int = 4000) -> Signals:
    """Twelve tones between a twentieth of the highest frequency [Hz] and it, 1.5 MV/m peak, at 20 kHz, from 0."""
    rng = np.random.default_rng(3)
    time = np.arange(1, samples + 1) / 20e3
    tones = rng.uniform(0.05, 1.0, 12) * highest
    field = np.sin(2 * np.pi * np.outer(time, tones) + rng.uniform(0, 2 * np.pi, 12)) @ rng.uniform(0.3, 1.0, 12)
    field -= field[0] * np.exp(-time * highest)
    return Signals(time=time, voltage=150.0 * field / np.max(np.abs(field)))


def fraction(model: Link, signals: Signals) -> np.ndarray:
    return model.step(model.init(Rest()), signals)[1].phase_fraction


def errors(signals: Signals, spacing: float = 0.35, **parameters: float) -> np.ndarray:
    """Front minus lattice."""
    lattice = Lattice(spacing=spacing, accuracy=1e-5, **parameters)
    return fraction(Front(**parameters), signals) - fraction(lattice, signals)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize(("rate", "limit"), [(1e5, 1.5e-4), (1e6, 3e-4), (1e7, 6e-4), (1e8, 1.3e-3)])
def test_nested_loops_at_four_rates(rate, limit):
    assert rms(errors(drive(LEGS, rate), spacing=0.25)) < limit


@pytest.mark.parametrize("rate", [1e5, 1e6, 1e7, 1e8])
@pytest.mark.parametrize("level", [-0.4, -0.2, 0.0, 0.3])
def test_holds_of_ten_seconds(rate, level):
    signals = drive([0, 1.5, level], rate, samples=20, hold=10.0)
    assert rms(errors(signals, spacing=0.25)[-40:]) < 6e-4


def test_narrow_distributions():
    assert rms(errors(drive(LEGS, 1e7), spacing=0.25, **NARROW)) < 3e-3


@pytest.mark.parametrize(("highest", "limit"), [(20.0, 1.2e-3), (200.0, 2.5e-3)])
def test_multisine(highest, limit):
    assert rms(errors(multisine(highest))) < limit


def test_field_noise_does_not_fill_the_memory():
    clean = drive(LEGS, 1e7, samples=8000)
    noise = np.random.default_rng(4).normal(0.0, 0.5, clean.time.size)  # 5 kV/m rms
    noisy = clean.replace(voltage=clean.voltage + noise)
    state, out = FRONT.step(FRONT.init(Rest()), noisy)
    assert rms(out.phase_fraction - fraction(Lattice(accuracy=1e-4), noisy)) < 1.2e-3
    quiet, _ = FRONT.step(FRONT.init(Rest()), clean)
    assert state[kernel.DEPTH] == quiet[kernel.DEPTH]


def test_one_sample_for_each_leg_is_enough():
    """The field is linear between samples however far apart; a hold of 10 s is one sample."""
    signals = drive([*LEGS, -0.4], 1e7, hold=10.0)
    ends = np.cumsum(np.abs(np.diff([*LEGS, -0.4])) * 0.1)
    turns = np.append(np.searchsorted(signals.time, ends - 1e-9), signals.time.size - 1)
    sparse = Signals(time=signals.time[turns], voltage=signals.voltage[turns])
    np.testing.assert_allclose(fraction(FRONT, sparse), fraction(FRONT, signals)[turns], atol=5e-4)


def test_a_jump_takes_no_time_and_moves_no_front():
    state, _ = FRONT.step(FRONT.init(Rest()), drive([0, 0.5], 1e7))
    end = state[kernel.TIME]
    there, _ = FRONT.step(state, Signals(time=np.array([end]), voltage=np.array([120.0])))
    _, back = FRONT.step(there, Signals(time=np.array([end]), voltage=np.array([50.0])))
    assert there[kernel.LEADER] == state[kernel.LEADER]
    # domains that flip to and fro follow at once
    assert back.phase_fraction[0] == pytest.approx(state[kernel.FRACTION], abs=2e-3)


def test_attempts_are_the_integral_of_the_rate():
    for z in (-5.0, -1.0, 0.0, 2.0, 20.0):
        expected = integrate.quad(lambda y: 1 / special.erfcx(y), -np.inf if z < -1 else z - 12, z)[0]
        if z - 12 > -12:
            expected += integrate.quad(lambda y: 1 / special.erfcx(y), -20, z - 12)[0]
        assert attempts(np.array([z]))[0] == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("spreads", [(5e11, 5e11), (1e12, 1e11), (1e10, 1e10)])
def test_everett_table_against_quadrature(spreads):
    coercive, interaction = Gaussian(5e5, spreads[0], 0.0), Gaussian(0.0, spreads[1])
    table = everett((Kind(1.0, coercive, interaction),))
    middle = table.values.shape[2] // 2
    for i, j in ((3, -3), (6, 1), (8, -11), (1, -14)):
        u, l = i * table.step, j * table.step  # noqa: E741
        c, m = (u - l) / 2, -(u + l) / 2

        def share(low, high, c=c):
            at = lambda x: float(coercive.at(np.array(x)))
            f = lambda x: at(x) * (special.ndtr(high(x) / interaction.sigma) - special.ndtr(low(x) / interaction.sigma))
            return integrate.quad(f, 0, c, points=[min(5e5, c)], epsabs=1e-10)[0]

        got = table.values[0, :, middle + i, middle + j, 0]
        assert got[TRIANGLE] == pytest.approx(share(lambda x, u=u: x - u, lambda x, low=l: -low - x), abs=3e-6)
        assert got[LOWER] == pytest.approx(share(lambda x, u=u: x - u, lambda x, m=m: m), abs=3e-6)
        assert got[UPPER] == pytest.approx(got[TRIANGLE] - got[LOWER], abs=1e-15)
    assert table.values[0, TRIANGLE, -1, 0, 0] == pytest.approx(1.0, abs=1e-6)


def test_a_table_of_the_gaussian_is_the_gaussian():
    fields = np.linspace(0, 3e6, 1001)
    table = Table(tuple(fields), tuple(Gaussian(0.5e6, 5e11).at(fields)))
    tabled = Front(coercive_density=table, coercive_field=9e6, coercive_field_spread=1e9)
    signals = drive(LEGS, 1e7)
    np.testing.assert_allclose(fraction(tabled, signals), fraction(FRONT, signals), atol=1e-4)


def test_identified_densities_as_in_the_lattice():
    """A skew, biased table: nothing in the front model relies on Gaussians."""
    fields = np.linspace(-1.2e6, 1.6e6, 57)
    weight = np.exp(-((fields - 2e5) ** 2) / np.where(fields < 2e5, 1e11, 6e11))
    parameters = {"interaction_density": Table(tuple(fields), tuple(weight))}
    signals = drive([0, 2.5, *LEGS[2:]], 1e7)
    front, lattice = Front(**parameters), Lattice(spacing=0.25, accuracy=1e-5, **parameters)
    after_front, out_front = front.step(front.init(Rest()), signals)
    _, out_lattice = lattice.step(lattice.init(Rest()), signals)
    late = signals.time > 0.7  # a lattice knows the virgin state of a lopsided density to half a domain only
    assert rms((out_front.phase_fraction - out_lattice.phase_fraction)[late]) < 6e-4
    np.testing.assert_allclose(out_front.polarization[late], out_lattice.polarization[late], atol=1e-3)
    assert after_front.size == kernel.STATE_SIZE


def test_same_parameters_as_the_lattice():
    """A chain changes from one to the other by its kind alone."""
    own, other = parameters_of(Front), parameters_of(Lattice)
    shared = {name: declared for name, declared in other.items() if name not in ("spacing", "cut", "accuracy")}
    for name, declared in shared.items():
        assert (own[name].unit, own[name].lower, own[name].upper) == (declared.unit, declared.lower, declared.upper)
    defaults = {f.name: f.default for f in dataclasses.fields(Lattice)}
    assert all(f.default == defaults[f.name] for f in dataclasses.fields(Front) if f.name in shared)


def test_block_cuts_do_not_change_a_bit():
    signals = multisine(200.0, samples=3000)
    whole, out = FRONT.step(FRONT.init(Rest()), signals)
    state, parts = FRONT.init(Rest()), []
    for at in range(0, 3000, 170):
        before = state.copy()
        block = Signals(time=signals.time[at : at + 170], voltage=signals.voltage[at : at + 170])
        after, part = FRONT.step(state, block)
        assert np.array_equal(state, before)
        state = after
        parts.append(part.polarization)
    assert np.array_equal(np.concatenate(parts), out.polarization)
    assert np.array_equal(state, whole)


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_inverse_gives_the_voltage_back(noise):
    signals = multisine(30.0)
    voltage = signals.voltage + np.random.default_rng(5).normal(0.0, noise, signals.time.size)
    start = FRONT.init(Rest(voltage=20.0))
    after, out = FRONT.step(start, signals.replace(voltage=voltage))
    inverted, found = FRONT.invert(start, Signals(time=signals.time, polarization=out.polarization))
    again, reproduced = FRONT.step(start, signals.replace(voltage=found.voltage))
    # two voltages a few mV apart may give the same polarization where a loop closes under noise
    np.testing.assert_allclose(found.voltage, voltage, atol=2e-5 if noise == 0 else 5e-3)
    np.testing.assert_allclose(reproduced.polarization, out.polarization, atol=2e-10)
    read_out = (kernel.STEEPNESS, kernel.FRACTION)  # what the state is remembered by is the same to the last bit
    np.testing.assert_array_equal(np.delete(again, read_out), np.delete(inverted, read_out))
    assert again[kernel.FRACTION] == pytest.approx(inverted[kernel.FRACTION], abs=1e-14)
    assert after[kernel.DEPTH] == inverted[kernel.DEPTH]


def test_closing_loops_glide_as_the_substeps_go():
    """Loops of a virgin specimen and loops in loops that close: the inverse tries through the substeps alone."""
    signals = drive([0, 1.5, -1.5, 1.5, 0.3, 1.2, 0.3, 1.5, -1.5, 1.7, -0.5, 0.6, 0, 0.6, -1.8], 3e6, samples=6000)
    start = FRONT.init(Rest())
    after, out = FRONT.step(start, signals)
    inverted, found = FRONT.invert(start, Signals(time=signals.time, polarization=out.polarization))
    assert after[kernel.DEPTH] == inverted[kernel.DEPTH]
    np.testing.assert_allclose(found.phase_fraction, out.phase_fraction, rtol=0, atol=1e-9)


def test_inverse_of_what_cannot_be_stays_finite():
    time = np.arange(1, 6) / 20e3
    target = np.array([0.1, np.nan, 5.0, -5.0, 0.0])
    _, out = FRONT.invert(FRONT.init(Rest()), Signals(time=time, polarization=target))
    assert out.voltage[1] == out.voltage[0]
    assert out.voltage[2] == 1000.0
    assert out.voltage[3] == -1000.0
    assert np.all(np.isfinite(out.voltage))
    assert np.all(np.isfinite(out.phase_fraction))


def test_rest_voltage_is_reached_slowly():
    resting = FRONT.init(Rest(time=2.0, voltage=70.0))
    expected, _ = FRONT.step(FRONT.init(Rest(time=-5.0)), Signals(time=np.array([2.0]), voltage=np.array([70.0])))
    assert np.array_equal(resting, expected)


def chirp() -> Signals:
    """Up to 1.5 MV/m, then about half of that by 1.3 thermal widths at 5 to 250 Hz: each loop lies within the last."""
    time = np.arange(1, 10_001) / 10e3
    width = FRONT.thermal_width * FRONT.layer_thickness
    swing = 75.0 + 1.3 * width * np.sin(2 * np.pi * (5.0 * time + 122.5 * time**2))
    return Signals(time=np.append([0.05, 0.1], 0.1 + time), voltage=np.append([150.0, 75.0], swing))


def test_loops_that_nearly_coincide_are_one_where_little_is_asked():
    """They are a dozen with which each sample merges; what they add is far below what was asked for."""
    ends, shares = {}, {}
    for accuracy in (1e-6, 1e-4):
        model = Front(accuracy=accuracy)
        state, out = model.step(model.init(Rest()), chirp())
        ends[accuracy], shares[accuracy] = state[kernel.DEPTH], out.phase_fraction
    assert ends[1e-4] < 0.5 * ends[1e-6]
    assert np.max(np.abs(shares[1e-4] - shares[1e-6])) < 5e-5


@njit
def pieces(table, begin, climb):  # type: ignore[no-untyped-def]
    """Attempts in a linear piece of field, and minus their slopes, at one threshold."""
    return _piece(table, 0.0, begin, begin + climb, 1.0)


@pytest.mark.parametrize("begin", [-6.0, -1.0, 0.5, 39.0, 60.0])
@pytest.mark.parametrize("climb", [0.05, 0.3, 5.0, -0.3, -40.0])
def test_a_piece_of_field_is_the_integral_of_the_rate(begin, climb):
    """However long it is; its slopes are those of the rate at its ends, and of thresholds beside."""
    table = front_table()

    def rate(z: float) -> float:
        return float(1.0 / special.erfcx(z))

    ends = sorted((begin, begin + climb))
    expected = integrate.quad(rate, *ends, limit=400, points=[p for p in (-3.0, 0.0) if ends[0] < p < ends[1]])[0]
    found, slope, bend = pieces(table, begin, climb)
    size = abs(climb)
    assert found == pytest.approx(expected / size, rel=3e-5)
    assert slope == pytest.approx((rate(begin + climb) - rate(begin)) / climb, rel=1e-3, abs=1e-9)
    if ends[1] >= LAST:
        return  # there the rate is a straight line, its second derivative a difference of what is nearly the same
    up, down = pieces(table, begin + 1e-3, climb)[1], pieces(table, begin - 1e-3, climb)[1]
    assert bend == pytest.approx((up - down) / 2e-3, rel=2e-2, abs=1e-6)


def test_memory_of_more_loops_than_fit():
    """Ever smaller loops: 300 nested ones, the innermost are forgotten, the outer ones still close."""
    sizes = np.repeat(np.linspace(3.0, 0.3, 300), 2) * np.tile([1.0, -1.0], 300)
    model = Front(domain_volume=1e-20)  # d is a tenth: the loops do not blur into each other
    signals = drive([0.0, *sizes, -3.2, 3.2], 1e6, samples=10)
    state, out = model.step(model.init(Rest()), signals)
    plain = fraction(model, drive([0.0, -3.2, 3.2], 1e6, samples=10))
    assert state[kernel.DEPTH] <= kernel.TURNS
    assert np.all((out.phase_fraction >= 0) & (out.phase_fraction <= 1))
    assert out.phase_fraction[-1] == pytest.approx(plain[-1], abs=1e-6)


@pytest.mark.parametrize(
    ("signals", "word"),
    [
        (Signals(time=np.array([1.0])), "voltage"),
        (Signals(time=np.array([1.0, 0.5]), voltage=np.zeros(2)), "sample 1"),
        (Signals(time=np.array([1.0]), voltage=np.array([np.nan])), "not finite"),
        (Signals(time=np.array([1.0]), voltage=np.array([1e9])), "1 GV/m"),
    ],
)
def test_bad_samples_are_named(signals, word):
    with pytest.raises(BenchError, match=word):
        FRONT.step(FRONT.init(Rest()), signals)


def test_bad_inverse_and_foreign_state_are_named():
    state = FRONT.init(Rest())
    with pytest.raises(BenchError, match="polarization"):
        FRONT.invert(state, Signals(time=np.array([1.0])))
    with pytest.raises(BenchError, match="sort it"):
        FRONT.invert(state, Signals(time=np.array([-1.0]), polarization=np.zeros(1)))
    with pytest.raises(BenchError, match="init"):
        FRONT.step(state[:-1], Signals(time=np.array([1.0]), voltage=np.zeros(1)))
    with pytest.raises(BenchError, match="barriers"):
        Front(coercive_density=Table((-1e5, 1e6), (1.0, 1.0)))


@pytest.mark.parametrize(("without", "limit"), [("interaction_field_spread", 6e-3), ("coercive_field_spread", 1.5e-3)])
def test_one_field_for_all(without, limit):
    """A spread of 0 is where the model is worst; without interaction fields all virgin domains are up."""
    difference = errors(drive([0.3, *LEGS[1:]], 1e7), spacing=0.25, **{without: 0.0})
    assert rms(difference) < limit
    assert abs(difference[0]) < 2e-3
