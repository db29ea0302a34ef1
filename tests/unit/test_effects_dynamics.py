"""Lags, modes, creep and limits against SciPy's linear systems, closed solutions and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lsim

from pzt_ros.effects.amplifier_bandwidth import AmplifierBandwidth
from pzt_ros.effects.amplifier_current_limit import AmplifierCurrentLimit
from pzt_ros.effects.cross_coupling import CrossCoupling
from pzt_ros.effects.load_stiffness import LoadStiffness
from pzt_ros.effects.mechanical_resonance import MechanicalResonance
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.effects.slow_relaxation import SlowRelaxation
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.structure import Structure

RNG = np.random.default_rng(11)
JUMP = 1e-9
"""Seconds that a step takes."""


def moved(link: Link, time: Array, displacement: Array) -> Array:
    return link.step(link.init(Rest()), Signals(time, displacement=displacement))[1].displacement


def driven(link: Link, time: Array, voltage: Array) -> Array:
    return link.step(link.init(Rest()), Signals(time, voltage=voltage))[1].voltage


def undone(link: Link, time: Array, displacement: Array) -> Array:
    return link.invert(link.init(Rest()), Signals(time, displacement=displacement))[1].displacement


def step_up(after: Array, height: float) -> tuple[Array, Array]:
    """A step at time 0, then samples at the times `after`."""
    time = np.concatenate(([-1.0, 0.0, JUMP], after))
    return time, np.where(time > 0.0, height, 0.0)


def wandering(count: int) -> Array:
    """A random walk that starts at 0: every frequency is in it."""
    return np.concatenate(([0.0], np.cumsum(RNG.normal(size=count - 1)))) * 1e-7


def mode_by_scipy(time: Array, drive: Array, frequency: float, damping: float) -> Array:
    w = 2 * math.pi * frequency
    return lsim(([w * w], [1.0, 2 * damping * w, w * w]), drive, time)[1]


def test_creep_after_a_step_is_the_sum_of_exponentials() -> None:
    link = SlowRelaxation(share=0.1, shortest_time=0.05, longest_time=5.0)
    after = np.geomspace(1e-4, 50.0, 60)
    time, y = step_up(after, 1e-5)
    taus = 0.05 * 100.0 ** np.linspace(0.0, 1.0, 5)
    expected = 1e-5 * (1 + 0.1 * np.mean(1 - np.exp(-after[:, None] / taus), axis=1))
    np.testing.assert_allclose(moved(link, time, y)[3:], expected, rtol=1e-7)


def test_creep_is_nearly_straight_over_log_time() -> None:
    """The usual creep law log10(t/t0), within the band."""
    link = SlowRelaxation(share=0.1, shortest_time=0.01, longest_time=100.0)
    after = np.geomspace(0.1, 10.0, 41)
    time, y = step_up(after, 1.0)
    creep = moved(link, time, y)[3:]
    line = np.polyval(np.polyfit(np.log10(after), creep, 1), np.log10(after))
    assert np.max(np.abs(creep - line)) < 0.05 * np.ptp(creep)


def test_creep_follows_a_drive_as_scipy_says() -> None:
    link = SlowRelaxation(share=0.2, shortest_time=0.01, longest_time=1.0)
    time, y = np.arange(3000) * 1e-3, wandering(3000)
    lags = [lsim(([1.0], [tau, 1.0]), y, time)[1] for tau in link.times]
    np.testing.assert_allclose(moved(link, time, y), y + 0.2 * np.mean(lags, axis=0), rtol=0, atol=1e-12 * np.ptp(y))


@pytest.mark.parametrize(("tilt", "shares"), [(0.0, (0.5, 0.5)), (0.4, (0.3, 0.7)), (-1.0, (1.0, 0.0))])
def test_creep_that_is_all_at_its_ends_is_that_of_two_elements(tilt: float, shares: tuple[float, float]) -> None:
    link = SlowRelaxation(share=0.2, shortest_time=0.02, longest_time=0.7, ends=1.0, tilt=tilt)
    time, y = np.arange(3000) * 1e-3, wandering(3000)
    late = sum(share * lsim(([1.0], [tau, 1.0]), y, time)[1] for share, tau in zip(shares, (0.02, 0.7), strict=True))
    creeping = moved(link, time, y)
    np.testing.assert_allclose(creeping, y + 0.2 * late, rtol=0, atol=1e-12 * np.ptp(y))
    np.testing.assert_allclose(undone(link, time, creeping), y, rtol=0, atol=1e-13)


def test_creep_that_is_tilted_has_more_of_the_slow_and_as_much_in_all() -> None:
    even = SlowRelaxation(share=0.1, ends=0.3)
    tilted = SlowRelaxation(share=0.1, ends=0.3, tilt=0.5)
    assert tilted.weights.sum() == pytest.approx(even.weights.sum(), rel=1e-14)
    np.testing.assert_allclose(tilted.weights / even.weights, [0.5, 0.75, 1.0, 1.25, 1.5], rtol=1e-14)


def test_creep_at_rest_is_balanced() -> None:
    link = SlowRelaxation(share=0.1)
    np.testing.assert_allclose(moved(link, np.linspace(3.0, 900.0, 50), np.full(50, 4e-6)), 4.4e-6, rtol=1e-14)


@pytest.mark.parametrize("share", [1.0, 0.3])
def test_mode_follows_a_drive_as_scipy_says(share: float) -> None:
    link = MechanicalResonance(share=share, frequency=120.0, damping_ratio=0.03)
    time, y = np.arange(4000) * 5e-4, wandering(4000)
    expected = (1 - share) * y + share * mode_by_scipy(time, y, 120.0, 0.03)
    np.testing.assert_allclose(moved(link, time, y), expected, rtol=0, atol=1e-10 * np.ptp(y))


def test_mode_rings_at_its_frequency_and_dies_out_by_its_damping() -> None:
    link = MechanicalResonance(share=1.0, frequency=347.0, damping_ratio=0.021)
    damped = 347.0 * math.sqrt(1 - 0.021**2)
    after = (1.0 + np.arange(20)) / (2 * damped)  # half periods
    time, y = step_up(after, 1e-6)
    overshoot = np.abs(moved(link, time, y)[3:] / 1e-6 - 1.0)
    decrement = math.pi * 0.021 / math.sqrt(1 - 0.021**2)
    np.testing.assert_allclose(overshoot, np.exp(-decrement * np.arange(1, 21)), rtol=1e-4)


def test_whole_mode_is_the_structure_link() -> None:
    """The two write the same physics in other variables."""
    time, y = np.cumsum(RNG.exponential(1e-3, 500)), wandering(500)
    structure = Structure(resonance_frequency=80.0, damping_ratio=0.1)
    effect = MechanicalResonance(share=1.0, frequency=80.0, damping_ratio=0.1)
    np.testing.assert_allclose(moved(effect, time, y), moved(structure, time, y), rtol=0, atol=1e-12 * np.ptp(y))


@pytest.mark.parametrize(("share", "step"), [(0.2, 1e-5), (0.5, 1e-3), (0.8, 1e-4), (1.0, 5e-3)])
def test_inverse_of_a_mode_is_exact_where_it_is_said_to_be(share: float, step: float) -> None:
    link = MechanicalResonance(share=share, frequency=300.0, damping_ratio=0.05)
    time, y = np.arange(2000) * step, wandering(2000)
    np.testing.assert_allclose(undone(link, time, moved(link, time, y)), y, rtol=0, atol=1e-8 * np.ptp(y))


def test_inverse_of_a_finely_sampled_mode_is_of_first_order() -> None:
    link = MechanicalResonance(share=1.0, frequency=300.0, damping_ratio=0.05)
    errors = []
    for step in (1e-4, 5e-5, 2.5e-5):
        time = np.arange(round(0.2 / step)) * step
        wanted = 1e-6 * (1 - np.cos(2 * np.pi * 20 * time))
        errors.append(np.max(np.abs(moved(link, time, undone(link, time, wanted)) - wanted)[time > 0.1]))
    assert errors[0] < 1e-8
    assert errors[1] < 0.6 * errors[0]
    assert errors[2] < 0.6 * errors[1]


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_sensor_is_late_by_its_lag_on_a_ramp(share: float) -> None:
    link = SensorLag(lag=3.7e-3, delay_share=share)
    time = np.cumsum(RNG.exponential(1e-3, 400))
    np.testing.assert_allclose(moved(link, time, 1e-3 * time)[200:], 1e-3 * (time[200:] - 3.7e-3), rtol=1e-12)


def test_sensor_bandwidth_as_scipy_says() -> None:
    time, y = np.arange(3000) * 1e-3, wandering(3000)
    expected = lsim(([1.0], [2.5e-3, 1.0]), y, time)[1]
    found = moved(SensorLag(lag=2.5e-3, delay_share=0.0), time, y)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.ptp(y))


@pytest.mark.parametrize("delay", [1e-6, 3.3e-4, 1e-3, 0.0427])
def test_delay_reads_the_straight_lines_that_much_earlier(delay: float) -> None:
    time, y = np.cumsum(RNG.exponential(1e-3, 3000)), wandering(3000)
    found = moved(SensorLag(lag=delay), time, y)
    np.testing.assert_allclose(found, np.interp(time - delay, time, y), rtol=0, atol=1e-12 * np.ptp(y))


def test_delay_and_bandwidth_together_are_exact_between_samples() -> None:
    """The delayed input has its corners between the samples; SciPy gets them on a grid that has them all."""
    delay, tau = 0.37e-3, 1.1e-3
    link = SensorLag(lag=delay + tau, delay_share=delay / (delay + tau))
    time, y = np.arange(500) * 1e-3, wandering(500)
    fine = np.arange(500 * 100) * 1e-5
    expected = lsim(([1.0], [tau, 1.0]), np.interp(fine - delay, time, y), fine)[1][::100]
    np.testing.assert_allclose(moved(link, time, y), expected, rtol=0, atol=1e-11 * np.ptp(y))


def test_long_delay_of_fast_samples_stays_within_its_memory() -> None:
    """Of 5000 samples under way 500 are kept, 0.2 ms apart: between them it is a straight line."""
    time = np.arange(30_000) * 2e-5
    y = 1e-6 * np.sin(2 * np.pi * 20 * time)
    link = SensorLag(lag=0.1)
    found = moved(link, time, y)
    assert link.init(Rest()).nbytes < 30_000
    np.testing.assert_allclose(found[6000:], y[1000:-5000], rtol=0, atol=1e-6 * (2 * np.pi * 20 * 2.2e-4) ** 2 / 8)


def test_bandwidth_has_the_gain_and_phase_of_a_lag() -> None:
    link = AmplifierBandwidth(time_constant=2e-3)
    time = np.arange(20_000) * 1e-5
    w = 2 * np.pi * 100.0
    found = driven(link, time, 50.0 * np.sin(w * time))[10_000:]
    response = 50.0 / (1 + 1j * w * 2e-3)
    expected = np.imag(response * np.exp(1j * w * time[10_000:]))
    np.testing.assert_allclose(found, expected, rtol=0, atol=50 * (w * 1e-5) ** 2 / 8)


@pytest.mark.parametrize("coefficient", [1e-6, 0.1, 0.25 - 1e-8, 0.25, 0.25 + 1e-8, 0.5, 1.0])
@pytest.mark.parametrize("time_constant", [2e-4, 5e-3])
def test_second_order_is_exact_for_straight_lines(coefficient: float, time_constant: float) -> None:
    """Against SciPy's own solution, with two poles far apart, near one another, one and complex ones."""
    link = AmplifierBandwidth(time_constant=time_constant, second_order=coefficient)
    time, command = np.arange(300) * 1e-3, 1e7 * wandering(300)
    expected = lsim(([1.0], [coefficient * time_constant**2, time_constant, 1.0]), command, time)[1]
    np.testing.assert_allclose(driven(link, time, command), expected, rtol=0, atol=1e-8 * np.ptp(command))


@pytest.mark.parametrize("coefficient", [0.0, 0.1, 0.25, 0.5, 1.0])
def test_the_exact_inverse_of_a_bandwidth_keeps_noise_within_bounds(coefficient: float) -> None:
    """At every rate at which it is taken: a unit on one sample asks for no more than 13.4 in all."""
    exact = []
    for ratio in np.geomspace(0.5, 20.0, 60):
        link = AmplifierBandwidth(time_constant=1e-3, second_order=coefficient)
        time, wanted = np.arange(400) * ratio * 1e-3, np.zeros(400)
        wanted[50] = 1.0
        _, needed = link.invert(link.init(Rest()), Signals(time, voltage=wanted))
        got = driven(link, time, needed.voltage)
        if np.allclose(got, wanted, rtol=0, atol=1e-12):
            exact.append(ratio)
            assert np.sum(np.abs(needed.voltage)) < 13.4
    assert len(exact) > 25
    assert exact[-1] == pytest.approx(20.0)


@pytest.mark.parametrize(
    "link",
    [
        AmplifierBandwidth(time_constant=5e-3),
        AmplifierBandwidth(time_constant=5e-3, second_order=0.2),
        SensorLag(lag=5e-3, delay_share=0.0),
    ],
)
def test_inverse_of_a_finely_sampled_lag_is_of_first_order(link: Link) -> None:
    errors = []
    for step in (1e-3, 5e-4, 2.5e-4):
        time = np.arange(round(0.5 / step)) * step
        wanted = 1.0 - np.cos(2 * np.pi * 5 * time)
        block = Signals(time, voltage=wanted, displacement=wanted)
        _, needed = link.invert(link.init(Rest()), block)
        _, got = link.step(link.init(Rest()), needed)
        errors.append(max(np.max(np.abs(got.voltage - wanted)), np.max(np.abs(got.displacement - wanted))))
    assert errors[1] < 0.55 * errors[0]
    assert errors[2] < 0.55 * errors[1]


def limited_by_brute_force(time: Array, command: Array, slew: float, substeps: int = 4000) -> Array:
    """Small steps towards the command, each no longer than the limit allows."""
    out, now = [command[0]], command[0]
    for k in range(1, len(time)):
        most = slew * (time[k] - time[k - 1]) / substeps
        for target in np.linspace(command[k - 1], command[k], substeps + 1)[1:]:
            now += min(max(target - now, -most), most)
        out.append(now)
    return np.array(out)


def test_current_limit_as_by_brute_force() -> None:
    """Catching up, overtaken from the other side, and never reached, all between two samples."""
    time = np.cumsum(RNG.exponential(1e-3, 120))
    command = np.cumsum(RNG.normal(size=120)) * 10.0
    found = driven(AmplifierCurrentLimit(inverse_slew=1 / 8e3), time, command)
    expected = limited_by_brute_force(time, command, 8e3)
    assert np.max(np.abs(found - command)) > 20.0
    np.testing.assert_allclose(found, expected, rtol=0, atol=0.05)


def test_current_limit_never_exceeds_its_slope_and_leaves_slow_drives_alone() -> None:
    time = np.arange(4000) * 1e-4
    command = 75.0 * (1 - np.cos(2 * np.pi * 20 * time))
    found = driven(AmplifierCurrentLimit(inverse_slew=1 / 5e3), time, command)
    assert np.max(np.abs(np.diff(found))) <= 5e3 * 1e-4 * (1 + 1e-9)
    fastest = 75.0 * 2 * np.pi * 20
    slow = driven(AmplifierCurrentLimit(inverse_slew=1 / (1.01 * fastest)), time, command)
    np.testing.assert_allclose(slow, command, rtol=0, atol=1e-12)


def test_current_limit_makes_a_ramp_of_a_step() -> None:
    time, command = step_up(np.linspace(1e-3, 0.05, 50), 100.0)
    found = driven(AmplifierCurrentLimit(inverse_slew=1 / 4e3), time, command)[3:]
    np.testing.assert_allclose(found, np.minimum(4e3 * time[3:], 100.0), rtol=0, atol=1e-9)


def test_voltage_that_the_limit_allows_needs_itself_as_command() -> None:
    link = AmplifierCurrentLimit(inverse_slew=1e-4)
    time = np.arange(200) * 1e-3
    possible = driven(link, time, 100.0 * np.sign(np.sin(40 * time)))
    _, asked = link.invert(link.init(Rest()), Signals(time, voltage=possible))
    np.testing.assert_allclose(driven(link, time, asked.voltage), possible, rtol=0, atol=1e-10)


def test_load_of_the_stack_s_own_stiffness_halves_the_stroke() -> None:
    time, y = np.arange(5.0), np.linspace(0.0, 1e-5, 5)
    half = LoadStiffness(load_stiffness=3e7, compliance=1.0 / 3e7)
    np.testing.assert_allclose(moved(half, time, y), 0.5 * y, rtol=1e-15)
    np.testing.assert_allclose(undone(half, time, 0.5 * y), y, rtol=1e-15)


def test_what_the_neighbour_moves_comes_through_and_is_undone() -> None:
    time, own, neighbour = np.arange(5.0), np.linspace(0.0, 1e-5, 5), np.array([0.0, 4.0, -2.0, 1.0, 8.0]) * 1e-6
    coupled, signals = CrossCoupling(coupling=0.01, bend=1e5), Signals(time, displacement=own, neighbour=neighbour)
    _, moved_on = coupled.step(coupled.init(Rest()), signals)
    expected = own + 0.01 * neighbour + 0.01 * 1e5 * neighbour**2
    np.testing.assert_allclose(moved_on.displacement, expected, rtol=1e-14)
    _, back = coupled.invert(coupled.init(Rest()), moved_on)
    np.testing.assert_allclose(back.displacement, own, rtol=0, atol=1e-20)
