"""Amplifier, Sawyer-Tower circuit, structure and sensor against closed forms and laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import signal

from pzt_ros.chains import load_chain
from pzt_ros.errors import BenchError
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.sawyer_tower import discharge
from pzt_ros.physics.sensor import DisplacementSensor
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.structure import Structure

RATE = 20e3
C_R, AREA = 133.5e-6, 2e-3
CERAMIC = Lattice(  # the thesis' P1 as methods.md section 6 has it, steep
    coercive_field_spread=1e11, interaction_field_spread=1e11, relaxation_time=0.05,
    domain_polarization=0.215, reciprocal_permittivity=2.8e7, spacing=2.0, accuracy=1e-5,
)  # fmt: skip


def uneven(duration: float, count: int, seed: int = 1) -> np.ndarray:
    """Rising times, steps up to a factor of about 30 apart."""
    steps = np.exp(np.random.default_rng(seed).normal(0, 0.8, count))
    return np.cumsum(steps) * duration / steps.sum()


def moved(link: Link, time: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    _, out = link.step(link.init(Rest()), Signals(time, displacement=displacement))
    return out.displacement


def voltage_out(link: Link, time: np.ndarray, command: np.ndarray) -> np.ndarray:
    _, out = link.step(link.init(Rest()), Signals(time, command))
    return out.voltage


# A lag: amplifier without load, and sensor


@pytest.mark.parametrize("corner", [20.0, 500.0, 2e4])
def test_lag_meets_scipy_on_even_samples(corner: float) -> None:
    """`lsim` is exact for straight lines between samples, by another way (matrix exponential)."""
    time = np.arange(0, 400) / RATE
    command = 50.0 * signal.sawtooth(2 * np.pi * 130 * time, 0.3) + 50.0
    command[0] = 0.0
    w = 2 * np.pi * corner
    _, expected, _ = signal.lsim(([w], [1.0, w]), command, time)
    np.testing.assert_allclose(voltage_out(Amplifier(bandwidth=corner), time, command), expected, rtol=0, atol=1e-10)
    reading = moved(DisplacementSensor(bandwidth=corner), time, 1e-6 * command)
    np.testing.assert_allclose(reading, 1e-6 * expected, rtol=0, atol=1e-16)


@pytest.mark.parametrize(
    "link", [DisplacementSensor(bandwidth=300.0), Structure(resonance_frequency=300.0, damping_ratio=0.1)]
)
def test_more_samples_on_a_straight_line_change_nothing(link: Link) -> None:
    """Exact for straight lines: uneven times, and any point between two of them, give the same curve."""
    coarse = uneven(0.02, 60)
    values = 1e-6 * np.random.default_rng(2).normal(size=60)
    fine = np.sort(np.concatenate([coarse, coarse[:-1] + np.diff(coarse) * np.random.default_rng(3).random(59)]))
    found = moved(link, fine, np.interp(fine, coarse, values))
    np.testing.assert_allclose(found[np.isin(fine, coarse)], moved(link, coarse, values), rtol=0, atol=1e-18)


def test_amplifier_bandwidth_is_3_decibel_down_at_its_corner() -> None:
    time = np.arange(1, 200_001) / 1e6
    out = voltage_out(Amplifier(bandwidth=1e3), time, np.sin(2 * np.pi * 1e3 * time))
    assert np.max(out[-2000:]) == pytest.approx(1 / math.sqrt(2), rel=1e-4)


def test_amplifier_window_and_slew_limit() -> None:
    time = np.arange(1, 401) / RATE
    amplifier = Amplifier(gain=2.0, voltage_limit=100.0, slew_rate=5e4)
    out = voltage_out(amplifier, time, np.full(400, 80.0))
    np.testing.assert_allclose(out, np.minimum(5e4 * time, 100.0), rtol=1e-12)
    down = voltage_out(amplifier, time, np.full(400, -80.0))
    np.testing.assert_allclose(down, -out)


@pytest.mark.parametrize(("corner", "order"), [(2e4, None), (200.0, 1)])
def test_inverse_of_the_lag(corner: float, order: int | None) -> None:
    """Exact where sampling is slow against the lag; where it is fast, an error of first order in the step."""
    errors = []
    for refinement in (1, 2):
        time = np.arange(1, 801 * refinement) / (RATE * refinement)
        command = 75.0 * (1 - np.cos(2 * np.pi * 50 * time))
        link = Amplifier(bandwidth=corner)
        _, out = link.step(link.init(Rest()), Signals(time, command))
        _, back = link.invert(link.init(Rest()), out)
        errors.append(np.max(np.abs(back.voltage - command)))
    if order is None:
        assert errors[0] < 1e-10
    else:
        assert errors[0] < 0.02 * 150
        assert errors[0] / errors[1] == pytest.approx(2**order, rel=0.1)


@pytest.mark.parametrize("ratio", [0.01, 0.1, 0.5, 0.99, 1.01, 3.0, 30.0])
def test_inverse_of_a_lag_stays_bounded_under_noise(ratio: float) -> None:
    """Step over time constant from fast to slow: the amplification of noise is what the differences cost, not more."""
    noise = np.random.default_rng(1).uniform(-1, 1, 5000) * 1e-6
    sensor = DisplacementSensor(bandwidth=ratio * RATE / (2 * np.pi))
    _, out = sensor.invert(sensor.init(Rest()), Signals(np.arange(5000) / RATE, displacement=noise))
    assert np.max(np.abs(out.displacement)) <= 1e-6 * max(1 + 2 / ratio, 14.0)


def test_absent_effects_are_exact_and_keep_no_state() -> None:
    time, values = np.arange(1, 9) / RATE, np.linspace(0, 1e-5, 8)
    for link in (Amplifier(), Structure()):
        assert link.init(Rest()).size == 0
    assert DisplacementSensor().init(Rest()).size == 2
    np.testing.assert_array_equal(moved(Structure(), time, values), values)
    np.testing.assert_array_equal(moved(DisplacementSensor(), time, values), values)
    np.testing.assert_array_equal(voltage_out(Amplifier(), time, values), values)


# Sensor


def test_delay_is_so_many_samples() -> None:
    values = np.random.default_rng(1).normal(size=50) * 1e-6
    reading = moved(DisplacementSensor(delay=7), np.arange(50) / RATE, values)
    np.testing.assert_array_equal(reading[7:], values[:-7])
    np.testing.assert_array_equal(reading[:7], values[0])


def test_delay_of_half_a_sample_is_refused() -> None:
    with pytest.raises(BenchError, match="whole number"):
        DisplacementSensor(delay=0.5).init(Rest())


@pytest.mark.parametrize(
    "link",
    [
        DisplacementSensor(bandwidth=400.0, delay=3, noise_rms=1e-9),
        Structure(resonance_frequency=900.0, damping_ratio=0.05, load_stiffness=1e7),
    ],
)
def test_blocks_may_be_cut_anywhere(link: Link) -> None:
    time, values = uneven(0.02, 97), 1e-6 * np.random.default_rng(4).normal(size=97)
    end, whole = link.step(link.init(Rest(seed=3)), Signals(time, displacement=values))
    state, parts = link.init(Rest(seed=3)), []
    for a, b in ((0, 1), (1, 2), (2, 40), (40, 97)):
        state, out = link.step(state, Signals(time[a:b], displacement=values[a:b]))
        parts.append(out.displacement)
    np.testing.assert_array_equal(np.concatenate(parts), whole.displacement)
    np.testing.assert_array_equal(state, end)


# Structure


@pytest.mark.parametrize("damping", [0.0, 0.02, 0.7, 0.95])
def test_mode_meets_scipy(damping: float) -> None:
    time = np.arange(0, 600) / RATE
    values = 1e-6 * signal.sawtooth(2 * np.pi * 210 * time, 0.5) + 1e-6
    w = 2 * np.pi * 1.1e3
    _, expected, _ = signal.lsim(([w * w], [1.0, 2 * damping * w, w * w]), values, time)
    found = moved(Structure(resonance_frequency=1.1e3, damping_ratio=damping), time, values)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-16)


def test_mode_without_damping_keeps_its_energy() -> None:
    """Free swing after a step: w^2 y^2 + v^2 is what it was, after 2,000 periods."""
    link = Structure(resonance_frequency=1e3, damping_ratio=0.0)
    state, _ = link.step(link.init(Rest()), Signals(np.array([0.0, 1e-4]), displacement=np.array([0.0, 1e-6])))

    def energy(state: np.ndarray) -> float:
        return (2 * np.pi * 1e3 * (state[3] - 1e-6)) ** 2 + state[4] ** 2

    start = energy(state)
    assert start > 0
    time = 1e-4 + uneven(2.0, 20_000)
    state, _ = link.step(state, Signals(time, displacement=np.full(20_000, 1e-6)))
    assert energy(state) == pytest.approx(start, rel=1e-9)


def test_static_gain_and_load_stiffness() -> None:
    """Two springs in series: k_A/(k_A + k_L) of the free displacement remains."""
    link = Structure(resonance_frequency=1e3, damping_ratio=0.5, load_stiffness=5e7, actuator_stiffness=1e8)
    time = np.array([0.0, 1e-3, 1.0])
    assert moved(link, time, np.array([0.0, 3e-6, 3e-6]))[-1] == pytest.approx(2e-6, rel=1e-12)


@pytest.mark.parametrize(("frequency", "limit"), [(55e3, 1e-12), (300.0, 0.03)])
def test_inverse_of_the_mode(frequency: float, limit: float) -> None:
    """Exact where the samples are slow against the mode and its inverse is stable; else close for a smooth motion."""
    link = Structure(resonance_frequency=frequency, damping_ratio=0.1)
    time = np.arange(1, 2001) / RATE
    values = 5e-6 * (1 - np.cos(2 * np.pi * 20 * time)) ** 2
    _, out = link.step(link.init(Rest()), Signals(time, displacement=values))
    _, back = link.invert(link.init(Rest()), out)
    assert np.max(np.abs(back.displacement - values)) <= limit * np.ptp(values)


@pytest.mark.parametrize("frequency", [100.0, 3e3, 7e3, 9.9e3, 21e3, 55e3, 1e6])
@pytest.mark.parametrize("damping", [0.0, 0.02, 0.5])
def test_inverse_of_the_mode_stays_bounded(frequency: float, damping: float) -> None:
    """Whether exact or by differences: a step is answered by finitely much, and what follows is flat again."""
    link = Structure(resonance_frequency=frequency, damping_ratio=damping)
    wanted = np.where(np.arange(4000) < 10, 0.0, 1e-6)
    _, out = link.invert(link.init(Rest()), Signals(np.arange(4000) / RATE, displacement=wanted))
    assert np.all(np.isfinite(out.displacement))
    np.testing.assert_allclose(out.displacement[-100:], 1e-6, rtol=1e-6)


# Amplifier with its load


def loaded(ceramic: Ferroelectric = CERAMIC, **amplifier: float | str) -> Chain:
    return Chain("loaded", (Amplifier(**amplifier), ceramic))


def drive(low: float, high: float, frequency: float, cycles: float) -> tuple[np.ndarray, np.ndarray]:
    """Half a second up to `high`, then sines down to `low` and back, at 20 kHz."""
    rise = np.arange(1, 10_001) / RATE
    since = np.arange(1, int(RATE * cycles / frequency) + 1) / RATE
    up = 0.5 * high * (1 - np.cos(2 * np.pi * rise))
    down = 0.5 * (high + low) + 0.5 * (high - low) * np.cos(2 * np.pi * frequency * since)
    return np.concatenate([rise, 0.5 + since]), np.concatenate([up, down])


def run(chain: Chain, time: np.ndarray, command: np.ndarray) -> tuple[Signals, np.ndarray]:
    """What comes out, and the charge [C] since rest."""
    state = chain.init(Rest())
    _, at_rest = Chain("ceramic", chain.links[1:]).step(state[1:], Signals(np.zeros(1), np.zeros(1)))
    _, out = chain.step(state, Signals(time, command))
    return out, AREA * (out.polarization - at_rest.polarization[0])


@pytest.mark.parametrize("ceramic", [CERAMIC, load_chain("thesis-p2").links[0]], ids=["lattice", "parametrized"])
def test_series_capacitor_takes_what_is_missing(ceramic: Ferroelectric) -> None:
    """Kirchhoff: command = ceramic + Q/C_r, with the same charge on both, at every sample."""
    time, command = drive(-40.0, 150.0, 5.0, 1.0)
    out, charge = run(loaded(ceramic, reference_capacitance=C_R), time, command)
    np.testing.assert_allclose(out.voltage + charge / C_R, command, rtol=0, atol=2e-8)
    assert np.max(np.abs(out.voltage - command)) > 2.0


def drive_error(compensation: str, full: bool) -> tuple[float, float]:
    """Largest error of the ceramic's voltage after the rise, and its law: the last step of U_r [V]."""
    time, command = drive(*((-150.0, 150.0, 1.0, 1.0) if full else (-40.0, 150.0, 100.0, 5.0)))
    out, charge = run(loaded(reference_capacitance=C_R, compensation=compensation), time, command)
    after = slice(10_100, None)
    step_of_reference = np.abs(np.diff(charge[after])).max() / C_R
    return float(np.abs(out.voltage - command)[after].max()), float(step_of_reference)


@pytest.mark.parametrize(("full", "volts"), [(True, 4.0), (False, 3.8)])
def test_drive_error_without_compensation(full: bool, volts: float) -> None:
    """methods.md 6: 4.0 V at 1 Hz full loop, 3.8 V at 100 Hz in the actuator range; the thesis says 6 V of 150."""
    error, _ = drive_error("none", full)
    assert error == pytest.approx(volts, rel=0.25)


@pytest.mark.parametrize(("full", "millivolts"), [(True, 3.5), (False, 16.0)])
def test_drive_error_with_the_last_measured_voltage(full: bool, millivolts: float) -> None:
    """What is missing is the step of U_r over one sample, i dt/C_r; the thesis' 0.5 % is far away.

    methods.md 6 has 16 mV at 100 Hz. Its 0.3 mV for the full loop would be a current of 0.8 mA where its own table has
    5 to 10 mA; 3.5 mV, which it gives for the extrapolation, fits the law. The rows seem to be swapped there.
    """
    error, law = drive_error("last", full)
    assert error == pytest.approx(law, rel=0.02)
    assert 1e3 * error == pytest.approx(millivolts, rel=0.5)
    assert error < 0.005 * 150


@pytest.mark.parametrize(("full", "millivolts"), [(True, 0.3), (False, 15.0)])
def test_drive_error_with_extrapolation(full: bool, millivolts: float) -> None:
    """Left over are the second differences of U_r: far below one step of U_r wherever the current is smooth."""
    error, law = drive_error("extrapolated", full)
    assert error < 0.3 * law
    assert 1e3 * error < millivolts


@pytest.mark.parametrize("compensation", ["none", "last", "extrapolated"])
def test_rows_far_apart_do_not_slow_the_computer_down(compensation: str) -> None:
    """A drive is linear between its rows: 25 samples a period apart say the same as all of them, to a millivolt."""
    time, command = np.arange(1, 8001) / RATE, 150.0 * np.arange(1, 8001) / 8000
    chain = loaded(reference_capacitance=C_R, compensation=compensation)
    dense, _ = run(chain, time, command)
    sparse, _ = run(chain, time[24::25], command[24::25])
    np.testing.assert_allclose(sparse.voltage, dense.voltage[24::25], rtol=0, atol=1e-3)
    _, back = chain.links[0].invert(chain.links[0].init(Rest()), Signals(time[24::25], sparse.voltage))
    np.testing.assert_allclose(back.voltage, command[24::25], rtol=0, atol=1e-6)


@pytest.mark.parametrize("ceramic", [CERAMIC, load_chain("thesis-p2").links[0]], ids=["lattice", "parametrized"])
def test_current_limit_holds_and_is_used(ceramic: Ferroelectric) -> None:
    """A jump of the command charges the ceramic with the constant limiting current until it is there."""
    time = np.arange(1, 2001) / RATE
    chain = loaded(ceramic, current_limit=0.02)
    out, charge = run(chain, time, np.full(2000, 100.0))
    current = np.diff(charge, prepend=0.0) * RATE
    assert np.max(np.abs(current)) <= 0.02 * (1 + 1e-4)
    busy = np.flatnonzero(out.voltage < 99.999)
    np.testing.assert_allclose(current[busy], 0.02, rtol=1e-4)
    assert np.all(np.diff(out.voltage[busy]) > 0)
    assert out.voltage[-1] == pytest.approx(100.0, abs=1e-9)
    free, _ = run(loaded(ceramic), time, np.full(2000, 100.0))
    assert free.voltage[0] == 100.0


def test_power_limit_holds() -> None:
    time = np.arange(1, 2001) / RATE
    out, charge = run(loaded(power_limit=1.0), time, np.full(2000, 100.0))
    power = np.abs(np.diff(charge, prepend=0.0) * RATE * out.voltage)
    assert 0.9 < np.max(power) <= 1.0 * (1 + 1e-4)


def test_slow_drive_does_not_feel_the_limits() -> None:
    time, command = drive(-40.0, 150.0, 5.0, 1.0)
    out, _ = run(loaded(current_limit=0.2, power_limit=30.0), time, command)
    np.testing.assert_allclose(out.voltage, command, rtol=0, atol=1e-9)


@pytest.mark.parametrize("compensation", ["none", "last", "extrapolated"])
def test_circuit_is_undone_exactly_and_may_be_cut(compensation: str) -> None:
    time, command = drive(-40.0, 150.0, 50.0, 2.0)
    time, command = time[::5], command[::5]
    chain = loaded(reference_capacitance=C_R, compensation=compensation, current_limit=0.2, bandwidth=5e3)
    link = chain.links[0]
    end, out = link.step(link.init(Rest()), Signals(time, command))
    _, back = link.invert(link.init(Rest()), Signals(time, out.voltage))
    np.testing.assert_allclose(back.voltage, command, rtol=0, atol=1e-6)
    state, parts = link.init(Rest()), []
    for a, b in ((0, 1), (1, 700), (700, 701), (701, time.size)):
        state, part = link.step(state, Signals(time[a:b], command[a:b]))
        parts.append(part.voltage)
    np.testing.assert_array_equal(np.concatenate(parts), out.voltage)
    np.testing.assert_array_equal(state, end)


def test_ceramic_takes_energy_over_a_cycle() -> None:
    """Passive: the integral of U dQ over a closed cycle is not below 0, with all limits in play."""
    time, command = drive(-150.0, 150.0, 5.0, 3.0)
    out, charge = run(loaded(reference_capacitance=C_R, current_limit=0.03, compensation="last"), time, command)
    cycle = slice(10_000 + 4_000, 10_000 + 8_000)
    middle = 0.5 * (out.voltage[cycle][1:] + out.voltage[cycle][:-1])
    assert np.sum(middle * np.diff(charge[cycle])) > 0.01


def test_chain_puts_the_ceramic_on_the_amplifier() -> None:
    chain = loaded(current_limit=0.1)
    assert chain.links[0].load is chain.links[1]  # type: ignore[attr-defined]
    assert chain.section("amplifier").links[0].load is chain.links[1]  # type: ignore[attr-defined]
    assert Chain("bare", (Amplifier(), CERAMIC)).links[0].load is None  # type: ignore[attr-defined]


def test_limit_without_a_ceramic_is_refused() -> None:
    with pytest.raises(BenchError, match="add a ferroelectric link"):
        Chain("none", (Amplifier(current_limit=0.1),)).init(Rest())


def test_bad_sample_is_named() -> None:
    for link in (loaded(current_limit=0.1).links[0], Amplifier(bandwidth=1e3)):
        with pytest.raises(BenchError, match="sample 1"):
            link.step(link.init(Rest()), Signals(np.array([1e-3, 2e-3]), np.array([0.0, math.nan])))
        with pytest.raises(BenchError, match="sample 1"):
            link.step(link.init(Rest()), Signals(np.array([1e-3, 0.5e-3]), np.array([0.0, 1.0])))


def test_discharge_moves_the_charge_through_the_resistor() -> None:
    """Small signal: exp(-t/RC) with C = A/(E_1 h); always: the charge that left is the integral of U/R."""
    ceramic = Lattice(coercive_field=5e6, coercive_field_spread=0, interaction_field_spread=0, relaxation_time=1.0)
    capacitance = AREA / (6e7 * 1e-4)
    time = np.arange(1, 2001) * 2e-6
    memory, out = ceramic.step(ceramic.init(Rest()), Signals(np.array([1e-3]), np.array([10.0])))
    start = (1e-3, 10.0, float(out.polarization[0]))
    _, voltage, polarization = discharge(ceramic, memory, start, 1e-3 + time, 10e3)
    np.testing.assert_allclose(voltage, 10.0 * np.exp(-time / (10e3 * capacitance)), rtol=2e-3)
    charge = AREA * (start[2] - polarization)
    np.testing.assert_allclose(charge, np.cumsum(voltage) * 2e-6 / 10e3, rtol=1e-9)


def test_discharge_of_a_switching_ceramic_ends_at_zero() -> None:
    time = np.arange(1, 3001) * 1e-4
    memory, out = CERAMIC.step(CERAMIC.init(Rest()), Signals(np.array([1.0]), np.array([150.0])))
    start = (1.0, 150.0, float(out.polarization[-1]))
    _, voltage, polarization = discharge(CERAMIC, memory, start, 1.0 + time)
    assert np.all(np.diff(voltage) < 0)
    assert 0 < voltage[-1] < 0.5  # 25 time constants on: what is left drives out what relaxes in the ceramic
    assert polarization[-1] > 0.1  # remanent
    left = AREA * (start[2] - polarization[-1])
    assert left == pytest.approx(np.sum(voltage) * 1e-4 / 10e3, rel=1e-9)
