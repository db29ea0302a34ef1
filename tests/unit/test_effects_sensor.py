"""Drift, hum and the sensor's curve against closed solutions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from pzt_ros.effects.mains_hum import MainsHum
from pzt_ros.effects.sensor_nonlinearity import SensorNonlinearity
from pzt_ros.effects.thermal_drift import ThermalDrift
from pzt_ros.effects.thermal_lag import ThermalLag
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array, Rest, Signals


def read(link: Link, signals: Signals) -> Array:
    return link.step(link.init(Rest()), signals)[1].displacement


def resting(time: Array) -> Signals:
    return Signals(time, displacement=np.full(time.shape, 3e-6))


def test_drift_is_a_straight_line_where_its_time_is_long() -> None:
    time = 500.0 + np.linspace(0.0, 60.0, 100)
    drift = read(ThermalDrift(rate=2e-9), resting(time)) - 3e-6
    np.testing.assert_allclose(drift, 2e-9 * (time - 500.0), rtol=4e-4, atol=1e-20)


def test_drift_dies_out_to_rate_times_time_constant() -> None:
    time = np.concatenate(([-7.0], np.geomspace(1.0, 1e4, 60) - 7.0))
    drift = read(ThermalDrift(rate=2e-9, time_constant=50.0), resting(time)) - 3e-6
    np.testing.assert_allclose(drift, 1e-7 * (1 - np.exp(-(time + 7.0) / 50.0)), rtol=1e-9, atol=1e-20)


def test_expansion_goes_with_a_measured_temperature() -> None:
    """Also where the temperature is known later than the displacement: it counts from its own first value."""
    link = ThermalDrift(expansion=3e-8)
    temperature = 293.0 + np.sin(np.arange(50.0))
    state, _ = link.step(link.init(Rest()), resting(np.array([-2.0, -1.0])))
    _, out = link.step(state, resting(np.arange(50.0)).replace(temperature=temperature))
    np.testing.assert_allclose(out.displacement - 3e-6, 3e-8 * np.sin(np.arange(50.0)), rtol=0, atol=1e-18)


def test_a_body_comes_after_the_temperature_of_the_air() -> None:
    """Against the closed answer of a lag to a ramp that begins at 0, in uneven blocks and steps."""
    time = np.sort(np.random.default_rng(0).uniform(0.0, 60.0, 400))
    time -= time[0]
    link, state = ThermalLag(expansion=3e-8, time_constant=6.0), ThermalLag().init(Rest())
    read_out = []
    for block in np.split(np.arange(400), [1, 130, 131, 300]):
        signals = resting(time[block]).replace(temperature=293.0 + 0.02 * time[block])
        state, out = link.step(state, signals)
        read_out.append(out.displacement - 3e-6)
    body = 0.02 * (time - 6.0 * (1.0 - np.exp(-time / 6.0)))
    np.testing.assert_allclose(np.concatenate(read_out), 3e-8 * body, rtol=0, atol=1e-16)


def test_a_body_that_is_behind_expands_on_in_still_air() -> None:
    time = np.linspace(5.0, 65.0, 100)
    link = ThermalLag(expansion=3e-8, time_constant=6.0, missing_expansion=2e-7)
    warm = read(link, resting(time).replace(temperature=np.full(100, 293.0))) - 3e-6
    np.testing.assert_allclose(warm, 2e-7 * (1 - np.exp(-(time - 5.0) / 6.0)), rtol=1e-9, atol=1e-20)


def test_a_temperature_that_is_known_late_is_followed_from_there() -> None:
    link = ThermalLag(expansion=3e-8, time_constant=6.0)
    state, out = link.step(link.init(Rest()), resting(np.array([-2.0, -1.0])))
    time = np.arange(50.0)
    _, warm = link.step(state, resting(time).replace(temperature=293.0 + 0.02 * time))
    body = 0.02 * (time - 6.0 * (1.0 - np.exp(-time / 6.0)))
    np.testing.assert_array_equal(out.displacement, 3e-6)
    np.testing.assert_allclose(warm.displacement - 3e-6, 3e-8 * body, rtol=0, atol=1e-16)


def test_hum_is_one_line_of_the_spectrum() -> None:
    time = 1e4 + np.arange(10_000) * 1e-3
    hum = read(MainsHum(frequency=50.0, detuning=0.3, sine=3e-9, cosine=4e-9), resting(time)) - 3e-6
    lines = np.fft.rfft(hum) / 5000.0
    assert np.argmax(np.abs(lines)) == 503
    assert lines[503] == pytest.approx(4e-9 - 3e-9j, abs=1e-15)  # the phase counts from the first sample
    assert np.sum(np.abs(lines) ** 2) == pytest.approx(25e-18, rel=1e-6)


def test_harmonics_of_hum_keep_to_its_frequency() -> None:
    time = np.arange(10_000) * 1e-3
    link = MainsHum(frequency=50.0, detuning=0.3, sine=1e-9, second_sine=2e-9, second_cosine=-1e-9, third_cosine=5e-9)
    lines = np.fft.rfft(read(link, resting(time)) - 3e-6) / 5000.0
    expected = {503: -1e-9j, 1006: -1e-9 - 2e-9j, 1509: 5e-9}
    np.testing.assert_allclose(lines[list(expected)], list(expected.values()), rtol=0, atol=1e-15)
    assert np.sum(np.abs(lines) ** 2) == pytest.approx(31e-18, rel=1e-6)


def test_sensor_curve_is_off_by_its_amplitude_at_the_end_of_the_range() -> None:
    end = Signals(np.array([0.0, 1.0]), displacement=np.array([1e-5, -1e-5]))
    quadratic = read(SensorNonlinearity(amplitude=0.01, mix=0.0, range=1e-5), end)
    cubic = read(SensorNonlinearity(amplitude=0.01, mix=0.5 * math.pi, range=1e-5), end)
    np.testing.assert_allclose(quadratic, [1.01e-5, -0.99e-5], rtol=1e-12)
    np.testing.assert_allclose(cubic, [1.01e-5, -1.01e-5], rtol=1e-12)


@pytest.mark.parametrize("mix", np.linspace(-math.pi, math.pi, 9))
@pytest.mark.parametrize("amplitude", [1e-3, 0.1, -0.1, 0.2])
def test_inverse_of_the_sensor_curve(amplitude: float, mix: float) -> None:
    link = SensorNonlinearity(amplitude=amplitude, mix=mix, range=1e-5)
    signals = Signals(np.arange(81.0), displacement=np.linspace(-1e-5, 1e-5, 81))
    _, back = link.invert(link.init(Rest()), signals.replace(displacement=read(link, signals)))
    np.testing.assert_allclose(back.displacement, signals.displacement, rtol=0, atol=1e-18)


def test_a_sensor_curve_bends_about_its_centre_and_back() -> None:
    link = SensorNonlinearity(amplitude=0.02, mix=0.3, quintic=-0.01, range=6e-6, centre=-1e-5)
    about_zero = dataclasses.replace(link, centre=0.0)
    u = np.linspace(-6e-6, 6e-6, 41)
    time = np.arange(41.0)
    moved = Signals(time, displacement=u - 1e-5)
    reading = read(link, moved)
    np.testing.assert_allclose(reading, read(about_zero, Signals(time, displacement=u)) - 1e-5, rtol=0, atol=1e-20)
    _, back = link.invert(link.init(Rest()), moved.replace(displacement=reading))
    np.testing.assert_allclose(back.displacement, moved.displacement, rtol=0, atol=1e-18)


def test_reading_that_the_sensor_cannot_give_is_its_last_one() -> None:
    """y - y^2/(2 R) rises up to y = R, where it reads R/2."""
    link = SensorNonlinearity(amplitude=-0.5, mix=0.0, range=1e-5)
    wanted = Signals(np.arange(3.0), displacement=np.array([4.8e-6, 6e-6, -5e-6]))
    _, back = link.invert(link.init(Rest()), wanted)
    expected = 1e-5 * (1 - np.sqrt(1 - 2 * np.array([0.48, 0.5, -0.5])))
    np.testing.assert_allclose(back.displacement, expected, rtol=0, atol=1e-18)
