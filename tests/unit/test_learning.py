"""Learning control on a linear stage, where the cycle-to-cycle error has a closed form; and where it must not learn."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.learning import Learning
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.reference import DISPLACEMENT, Reference, block_times

RATE, SIZE, PERIOD = 20e3, 20, 0.02
CYCLE = round(PERIOD * RATE)


@dataclass(frozen=True, kw_only=True)
class LinearStage(Link):
    """A stage without hysteresis."""

    kind: ClassVar[str] = "linear_stage"
    section: ClassVar[str] = ACTUATOR
    sensitivity: float = 1e-7

    def init(self, rest: Rest) -> State:
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        return state, signals.replace(displacement=self.sensitivity * signals.voltage)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        return state, signals.replace(voltage=signals.displacement / self.sensitivity)


MODEL = Chain("model", (LinearStage(),))
SCAN = 5e-6 - 2e-6 * np.cos(2 * np.pi * np.arange(1, CYCLE + 1) / CYCLE)


def cycles_of(
    controller: Learning, reference: np.ndarray, wrong: float, noise: float = 0.0, begin: int = 0
) -> np.ndarray:
    """Rms error of each cycle [m], from sample `begin` of it on, on a stage that moves `wrong` times as far."""
    loop = ControlLoop(MODEL, {"learning": controller}, Rest(), active="learning")
    random, sensitivity = np.random.default_rng(1), wrong * 1e-7
    voltage = np.full(SIZE, reference[0] / sensitivity)
    errors = []
    for block, asked in enumerate(reference.reshape(-1, SIZE)):
        reading = sensitivity * voltage + noise * random.normal(size=SIZE)
        feedback = Feedback(block_times(block, SIZE, RATE), voltage, reading, reading)
        voltage = loop.step(Reference(DISPLACEMENT, block_times(block + 1, SIZE, RATE), asked), feedback)
        errors.append(asked - sensitivity * voltage)
    return np.sqrt(np.mean(np.concatenate(errors).reshape(-1, CYCLE)[:, begin:] ** 2, axis=1))


CONTROLLER = Learning(period=PERIOD, smoothing=0.0, handover_time=1e-3)


def test_every_cycle_takes_its_share_of_the_error() -> None:
    """Plant over model is g = 1.3: a cycle leaves |1 - g share| of the error; shares are 1, 2/3, 1/2, 2/5."""
    # a cycle's first block does not yet know the last one's correction, and the first correction blends in
    fine = dataclasses.replace(CONTROLLER, least_gain=0.3, slow_gain=0.0)
    errors = cycles_of(fine, np.tile(SCAN, 8), 1.3, begin=2 * SIZE)
    shares = 2.0 / np.arange(2.0, 9.0)
    np.testing.assert_allclose(errors[2:] / errors[1:-1], np.abs(1.0 - 1.3 * np.maximum(shares, 0.3))[1:], rtol=0.02)
    assert errors[-1] < 0.02 * errors[0]


def test_the_slow_part_keeps_a_larger_share() -> None:
    """The error is a cosine over the period, all of which is slow: it goes on by the share 1/2."""
    errors = cycles_of(dataclasses.replace(CONTROLLER, slow_gain=0.5), np.tile(SCAN, 8), 1.3, begin=2 * SIZE)
    np.testing.assert_allclose(errors[3:] / errors[2:-1], 1.0 - 1.3 * 0.5, rtol=0.05)


def test_noise_is_averaged_over_cycles_and_neighbours() -> None:
    noise = 4e-8
    smoothed = dataclasses.replace(CONTROLLER, smoothing=1e-4, least_gain=0.1)
    errors = cycles_of(smoothed, np.tile(SCAN, 30), 1.05, noise)
    assert np.mean(errors[-5:]) < 0.25 * noise
    unsmoothed = cycles_of(CONTROLLER, np.tile(SCAN, 30), 1.05, noise)
    assert np.mean(unsmoothed[-5:]) > 0.3 * noise, "without, most of a share's noise stays"


def test_nothing_is_corrected_that_was_not_asked_before() -> None:
    """Another reference in every cycle: the error is that of the inverse alone."""
    growing = np.concatenate([5e-6 + (1.0 + 0.2 * k) * (SCAN - 5e-6) for k in range(8)])
    errors = cycles_of(CONTROLLER, growing, 1.1)
    inverse_alone = 0.1 * np.sqrt(np.mean(growing.reshape(-1, CYCLE) ** 2, axis=1))
    np.testing.assert_allclose(errors[1:], inverse_alone[1:], rtol=1e-3)


def test_another_scan_is_learned_anew() -> None:
    other = 6e-6 - 1e-6 * np.sin(2 * np.pi * np.arange(1, CYCLE + 1) / CYCLE)
    errors = cycles_of(CONTROLLER, np.concatenate((np.tile(SCAN, 6), np.tile(other, 6))), 1.2)
    assert errors[5] < 0.05 * errors[0]
    assert errors[6] > 0.5 * errors[0], "the first cycle of the other scan knows nothing of it"
    assert errors[11] < 0.05 * errors[6]


@pytest.mark.parametrize("period", [0.0199, 0.0201, 0.05])
def test_a_wrong_period_does_no_harm(period: float) -> None:
    wrong = dataclasses.replace(CONTROLLER, period=period)
    errors = cycles_of(wrong, np.tile(SCAN, 12), 1.1)
    assert np.max(errors[1:]) < 1.3 * errors[0] + 1e-9


def test_the_correction_is_limited() -> None:
    errors = cycles_of(dataclasses.replace(CONTROLLER, correction_limit=1e-7), np.tile(SCAN, 8), 1.5)
    alone = 0.5 * np.sqrt(np.mean(SCAN**2))
    assert errors[-1] == pytest.approx(alone, abs=2e-7)
    assert errors[-1] < errors[0]
