"""The displacement sensor: its noise is white, normal, repeatable, and its steps are steps."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from pzt_ros.physics.sensor import DisplacementSensor, white_noise
from pzt_ros.physics.signals import Rest, Signals

COUNT = 100_000
SIGMAS = 4.0
"""Width of the bands below: a sound generator leaves one of them once in 16,000 seeds; ours are fixed."""


@pytest.mark.parametrize("seed", [0, 1, 2, 12345, 2**53 - 1])
def test_noise_is_white_and_normal(seed: int) -> None:
    noise = white_noise(seed, 0, COUNT)
    assert abs(noise.mean()) < SIGMAS / math.sqrt(COUNT)
    assert abs(noise.std() - 1.0) < SIGMAS / math.sqrt(2 * COUNT)
    assert abs(np.mean(noise**3)) < SIGMAS * math.sqrt(15 / COUNT)  # moments of a normal: var(x^3) = 15
    assert abs(np.mean(noise**4) - 3.0) < SIGMAS * math.sqrt(96 / COUNT)  # var(x^4) = 105 - 9
    for lag in (1, 2, 3, 7, 100):
        assert abs(np.mean(noise[lag:] * noise[:-lag])) < SIGMAS / math.sqrt(COUNT - lag), lag
        # squares, too: a generator that uses a number twice is uncorrelated and yet not independent
        squares = (noise[lag:] ** 2 - 1.0) * (noise[:-lag] ** 2 - 1.0)
        assert abs(squares.mean()) < SIGMAS * 2.0 / math.sqrt(COUNT - lag), lag  # var(x^2) = 2


def test_spectrum_is_flat() -> None:
    power = np.abs(np.fft.rfft(white_noise(3, 0, COUNT))[1:-1]) ** 2 / COUNT
    bands = power[: len(power) // 10 * 10].reshape(10, -1)
    scatter = 1.0 / math.sqrt(bands.shape[1])  # a periodogram's bins are exponential: standard deviation = mean
    assert np.all(np.abs(bands.mean(axis=1) - 1.0) < SIGMAS * scatter)


@pytest.mark.parametrize(("one", "other"), [(0, 1), (0, 2), (1, 2), (7, 8), (1, 2**32), (1, 2**52)])
def test_seeds_are_independent(one: int, other: int) -> None:
    a, b = white_noise(one, 0, COUNT), white_noise(other, 0, COUNT)
    for lag in (0, 1, 2):
        for late, early in ((a[lag:], b[: COUNT - lag]), (b[lag:], a[: COUNT - lag])):
            assert abs(np.mean(late * early)) < SIGMAS / math.sqrt(COUNT - lag)
            assert abs(np.mean((late**2 - 1.0) * (early**2 - 1.0))) < SIGMAS * 2.0 / math.sqrt(COUNT - lag)


def test_no_number_comes_twice() -> None:
    assert np.unique(white_noise(1, 0, COUNT)).size == COUNT


def test_noise_does_not_know_how_it_was_cut() -> None:
    whole = white_noise(9, 0, 1000)
    cuts = [0, 1, 2, 50, 51, 333, 1000]
    parts = [white_noise(9, a, b - a) for a, b in itertools.pairwise(cuts)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    np.testing.assert_array_equal(white_noise(9, 10**12, 5), white_noise(9, 10**12 - 5, 10)[5:])


def read(sensor: DisplacementSensor, displacement: np.ndarray, seed: int = 1) -> np.ndarray:
    time = np.arange(displacement.size) * 50e-6
    _, out = sensor.step(sensor.init(Rest(seed=seed)), Signals(time, displacement=displacement))
    return out.displacement


def test_reading_is_offset_plus_noise() -> None:
    displacement = np.linspace(0.0, 1e-5, 2000)
    np.testing.assert_array_equal(read(DisplacementSensor(), displacement), displacement)
    np.testing.assert_array_equal(read(DisplacementSensor(offset=3e-6), displacement), displacement + 3e-6)
    noisy = read(DisplacementSensor(offset=3e-6, noise_rms=20e-9), displacement, seed=4)
    np.testing.assert_allclose(
        noisy - displacement - 3e-6, 20e-9 * white_noise(4, 0, displacement.size), rtol=0, atol=1e-20
    )


def test_reading_comes_in_steps() -> None:
    displacement = np.linspace(-1e-6, 1e-6, 4001)
    reading = read(DisplacementSensor(resolution=1e-7), displacement)
    steps = reading / 1e-7
    np.testing.assert_allclose(steps, np.round(steps), rtol=0, atol=1e-9)
    assert np.unique(np.round(steps)).size == 21
    assert np.max(np.abs(reading - displacement)) <= 0.5e-7 * (1 + 1e-9)
    assert np.all(np.diff(reading) >= 0.0)
