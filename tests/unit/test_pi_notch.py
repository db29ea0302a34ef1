"""The notch against its transfer function, and against a mode that PI alone cannot hold."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.pi_notch import NotchPI
from pzt_ros.physics.chain import Chain
from pzt_ros.reference import block_times

RATE, SIZE = 20e3, 200
NO_MODEL = Chain("none", ())


def answer(controller: NotchPI, error: np.ndarray, voltage: float = 0.0) -> np.ndarray:
    """Output [V] for a tracking error [m], block by block."""
    out, state = [], None
    for block, part in enumerate(error.reshape(-1, SIZE)):
        time = block_times(block, SIZE, RATE)
        zero = np.zeros(SIZE)
        feedback = Feedback(time, np.full(SIZE, voltage), zero, zero, part)
        state = controller.init(NO_MODEL, feedback) if state is None else state
        state, drive = controller.step(NO_MODEL, state, block_times(block + 1, SIZE, RATE), zero, feedback)
        out.append(drive)
    return np.concatenate(out)


@pytest.mark.parametrize("depth", [0.0, 0.1, 1.0])
def test_in_the_middle_its_depth_is_left(depth: float) -> None:
    notch = NotchPI(proportional_gain=1e6, integral_gain=0.0, notch_frequency=800.0, notch_depth=depth)
    time = np.arange(40 * SIZE) / RATE
    out = answer(notch, 1e-6 * np.sin(2 * np.pi * 800.0 * time))[-10 * SIZE :]
    assert np.max(np.abs(out)) == pytest.approx(depth, abs=2e-3)


@pytest.mark.parametrize("frequency", [50.0, 400.0, 900.0, 3000.0])
def test_elsewhere_it_is_its_transfer_function(frequency: float) -> None:
    """By the bilinear transform with the middle kept, from its continuous form, as scipy has it."""
    width, depth, middle = 0.5, 0.05, 1000.0
    w = 2 * RATE * np.tan(np.pi * middle / RATE)
    continuous = ([1.0, 2 * width * depth * w, w * w], [1.0, 2 * width * w, w * w])
    b, a = signal.bilinear(*continuous, fs=RATE)
    _, response = signal.freqz(b, a, worN=[frequency], fs=RATE)
    time = np.arange(100 * SIZE) / RATE
    out = answer(NotchPI(proportional_gain=1e6, integral_gain=0.0, notch_width=width, notch_depth=depth),
                 1e-6 * np.sin(2 * np.pi * frequency * time))[-20 * SIZE :]  # fmt: skip
    amplitude = np.sqrt(2.0 * np.mean(out**2))
    assert amplitude == pytest.approx(abs(response[0]), rel=0.02)


def test_it_continues_the_voltage_found() -> None:
    out = answer(NotchPI(integral_gain=0.0), np.zeros(4 * SIZE), voltage=73.0)
    np.testing.assert_allclose(out, 73.0, rtol=1e-12)


def test_above_the_nyquist_frequency_there_is_none() -> None:
    error = 1e-6 * np.random.default_rng(1).normal(size=2 * SIZE)
    out = answer(NotchPI(proportional_gain=1e6, integral_gain=0.0, notch_frequency=11e3), error)
    np.testing.assert_allclose(out, 1e6 * error, rtol=1e-9)


def test_it_holds_a_mode_that_pi_alone_does_not() -> None:
    """A lightly damped mode at 1 kHz, sample by sample: the same integral gain rings without the notch."""
    from pzt_ros.controllers.pi import PI

    gain, mode = (
        1e-7,
        signal.cont2discrete(([(2e3 * np.pi) ** 2], [1.0, 2 * 0.01 * 2e3 * np.pi, (2e3 * np.pi) ** 2]), 1.0 / RATE),
    )
    a = mode[1]
    b = mode[0].ravel()

    def ends(controller: PI | NotchPI) -> float:
        y, u, state, errors = [0.0, 0.0], [0.0, 0.0], None, []
        for k in range(2000):
            time = np.array([k / RATE])
            reading = np.array([y[-1]])
            feedback = Feedback(time, np.array([u[-1]]), reading, reading, np.array([1e-6]))
            state = controller.init(NO_MODEL, feedback) if state is None else state
            state, drive = controller.step(NO_MODEL, state, time + 1.0 / RATE, np.array([1e-6]), feedback)
            u.append(float(np.clip(drive[0], -1e3, 1e3)))
            y.append(float(-a[1] * y[-1] - a[2] * y[-2] + gain * (b[1] * u[-1] + b[2] * u[-2])))
            errors.append(1e-6 - y[-1])
        return float(np.max(np.abs(errors[-200:])))

    ki = 5e9
    assert ends(PI(integral_gain=ki)) > 1e-6
    assert ends(NotchPI(integral_gain=ki, notch_frequency=1000.0)) < 1e-9
