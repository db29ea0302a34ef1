"""The disturbance observer against the step response of a first-order filter, and on what is behind an amplifier."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from pzt_ros.observers.disturbance import DisturbanceObserver
from pzt_ros.observers.observer import Estimate
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals

RATE = 20e3
GAIN = 200.0
SENSITIVITY = 1e-7
"""Of the linear stage below [m/V]."""


@dataclass(frozen=True, kw_only=True)
class LinearStage(Link):
    """A stage without hysteresis, so that everything has a closed form."""

    kind: ClassVar[str] = "linear_stage"
    section: ClassVar[str] = ACTUATOR

    def init(self, rest: Rest) -> State:
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        return state, signals.replace(displacement=SENSITIVITY * signals.voltage)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        return state, signals.replace(voltage=signals.displacement / SENSITIVITY)


LINEAR = Chain("linear", (LinearStage(),))


def observe(model: Chain, voltage: np.ndarray, measurement: np.ndarray, gain: float = GAIN, size: int = 50) -> Estimate:
    """Everything the observer says, blocks joined."""
    observer = DisturbanceObserver(gain=gain)
    state, estimates = observer.init(model, Rest()), []
    time = np.arange(voltage.size) / RATE
    for begin in range(0, voltage.size, size):
        part = slice(begin, begin + size)
        state, estimate = observer.update(model, state, time[part], voltage[part], measurement[part])
        estimates.append(estimate)
    names = Estimate.__dataclass_fields__
    return Estimate(**{name: np.concatenate([getattr(e, name) for e in estimates]) for name in names})


def test_disturbance_follows_a_step_as_a_first_order_filter() -> None:
    """w' = L (d - w) has w = d (1 - exp(-L t)), at the samples to rounding."""
    voltage = 50.0 + 50.0 * np.sin(np.arange(2000) / 100)
    step, begin = 1e-6, 400
    extra = np.where(np.arange(2000) < begin, 0.0, step)
    estimate = observe(LINEAR, voltage, SENSITIVITY * voltage + extra)
    # the filter has seen the step for one sample at the sample where it comes
    since = np.maximum(np.arange(2000) - begin + 1, 0) / RATE
    expected = step * (1.0 - np.exp(-GAIN * since))
    np.testing.assert_allclose(estimate.disturbance, expected, rtol=0, atol=1e-9 * step)
    np.testing.assert_allclose(estimate.displacement, SENSITIVITY * voltage + expected, rtol=0, atol=1e-9 * step)
    one_before = np.concatenate(([0.0], expected[:-1]))
    np.testing.assert_allclose(estimate.innovation, extra - one_before, rtol=0, atol=1e-9 * step)


@pytest.mark.parametrize("gain", [1.0, 100.0, 5e3])
def test_time_constant_is_the_inverse_of_the_gain(gain: float) -> None:
    samples = round(3 * RATE / gain)
    measurement = np.concatenate(([0.0], np.full(samples, 1e-6)))
    estimate = observe(LINEAR, np.zeros(samples + 1), measurement, gain=gain, size=samples + 1)
    assert estimate.disturbance[-1] == pytest.approx(1e-6 * (1 - np.exp(-gain * samples / RATE)), rel=1e-9)


def test_first_measurement_takes_up_the_offset() -> None:
    voltage = np.linspace(0.0, 100.0, 200)
    estimate = observe(LINEAR, voltage, SENSITIVITY * voltage - 4e-6)
    np.testing.assert_allclose(estimate.disturbance, -4e-6, rtol=1e-9)
    np.testing.assert_allclose(estimate.innovation, 0.0, rtol=0, atol=1e-18)


def test_without_gain_nothing_is_learned_after_the_first_measurement() -> None:
    voltage = np.zeros(200)
    estimate = observe(LINEAR, voltage, np.linspace(1e-6, 2e-6, 200), gain=0.0)
    np.testing.assert_array_equal(estimate.disturbance, np.full(200, 1e-6))
    np.testing.assert_allclose(estimate.innovation, np.linspace(0.0, 1e-6, 200), rtol=0, atol=1e-18)


def test_noise_is_averaged() -> None:
    """Variance of a first-order filter of white noise: s / (2 - s) of that of the noise, s = 1 - exp(-L/f)."""
    noise = 1e-8 * np.random.default_rng(2).normal(size=200_000)
    estimate = observe(LINEAR, np.zeros(noise.size), noise, size=20_000)
    share = 1.0 - np.exp(-GAIN / RATE)
    assert np.std(estimate.disturbance[5000:]) == pytest.approx(1e-8 * np.sqrt(share / (2 - share)), rel=0.1)


def test_applied_voltage_is_not_amplified_again() -> None:
    """`applied` is measured behind the amplifier; a model with its gain in it must not multiply it once more."""
    model = Chain("amplified", (Amplifier(gain=27.8), LinearStage()))
    voltage = np.linspace(0.0, 100.0, 200)
    estimate = observe(model, voltage, SENSITIVITY * voltage)
    np.testing.assert_allclose(estimate.innovation, 0.0, rtol=0, atol=1e-18)
    np.testing.assert_allclose(estimate.displacement, SENSITIVITY * voltage, rtol=1e-12, atol=1e-18)
