"""Bounds and anti-windup against the recursion one writes by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Feedback, tracking_error
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.controllers.pi import PI, proportional_integral
from pzt_ros.physics.signals import Rest
from pzt_ros.reference import DISPLACEMENT, Reference, block_times

RATE = 20e3
BOUNDS = Bounds(voltage_min=-10.0, voltage_max=100.0, slew_rate=20e3)
STEP = 1.0
"""That the slew rate allows in a sample [V]."""


def by_hand(wanted: list[float], last: float) -> list[float]:
    kept = []
    for voltage in wanted:
        if math.isfinite(voltage):
            inside = max(min(voltage, 100.0), -10.0)
            last = max(min(inside, last + STEP), last - STEP)
        kept.append(last)
    return kept


def test_bounds_are_those_written_by_hand() -> None:
    random = np.random.default_rng(2)
    wanted = 45.0 + 80.0 * np.sin(np.arange(2000) / 150.0) + random.normal(0.0, 3.0, 2000)
    wanted[random.integers(0, 2000, 50)] = np.nan
    wanted[random.integers(0, 2000, 50)] = np.inf
    time = block_times(1, 2000, RATE)
    kept = BOUNDS.keep(wanted, 55.0, time, time[0] - 1.0 / RATE)
    np.testing.assert_allclose(kept, by_hand(list(wanted), 55.0), rtol=0, atol=1e-6)
    assert kept.min() == pytest.approx(-10.0)
    assert kept.max() == pytest.approx(100.0)


def test_what_is_within_bounds_is_left_as_it_is() -> None:
    wanted = 50.0 + 40.0 * np.sin(np.arange(1, 2001) / 100.0)
    time = block_times(1, 2000, RATE)
    np.testing.assert_array_equal(BOUNDS.keep(wanted, 50.0, time, time[0] - 1.0 / RATE), wanted)


def test_an_integral_does_not_grow_towards_what_the_bounds_cut() -> None:
    error = np.concatenate((np.full(10, 2.0), np.full(10, -2.0)))
    wound, _ = proportional_integral(error[:10], 0.0, 0.0, 0.5, 1e9, 0.0)
    held, _ = proportional_integral(error[:10], 0.0, 0.0, 0.5, 1e9, 3.0)
    back, _ = proportional_integral(error[10:], 0.0, 0.0, 0.5, 1e9, 3.0)
    assert (wound, held, back) == (10.0, 0.0, -10.0)


def test_pi_leaves_the_window_as_soon_as_its_error_turns() -> None:
    """A second at the window's end, then the error turns: the voltage falls within two samples, not within a second."""
    loop = ControlLoop(load_chain("thesis-p2"), {"pi": PI(integral_gain=1e9)}, Rest(), active="pi", bounds=BOUNDS)
    voltage = np.zeros(100)
    commands = []
    for block in range(300):
        time = block_times(block, 100, RATE)
        error = 1e-6 if block < 200 else -1e-6
        feedback = Feedback(time, voltage, np.full(100, 5e-6), np.full(100, 5e-6))
        voltage = loop.step(
            Reference(DISPLACEMENT, block_times(block + 1, 100, RATE), np.full(100, 5e-6 + error)), feedback
        )
        commands.append(voltage)
    series = np.concatenate(commands)
    assert series[201 * 100 - 1] == pytest.approx(100.0)
    assert loop.limited > 0
    fall = series[202 * 100 : 204 * 100]
    assert np.all(np.diff(fall) < 0.0), "the next block after the error was measured already falls"


def test_a_missing_sample_is_no_error() -> None:
    time = block_times(0, 4, RATE)
    feedback = Feedback(time, time, np.array([1.0, np.nan, np.inf, 4.0]), time, np.full(4, 5.0))
    np.testing.assert_array_equal(tracking_error(feedback), [4.0, 0.0, 0.0, 1.0])


def test_the_bounds_are_those_of_the_stack_behind_a_gain() -> None:
    import dataclasses

    from pzt_ros.physics.amplifier import Amplifier

    plain = load_chain("thesis-p2")
    model = dataclasses.replace(plain, links=(Amplifier(gain=16.0), *plain.links))
    loop = ControlLoop(model, {"open_loop": OpenLoop(gain=1e-7)}, Rest(), bounds=BOUNDS)
    time, zero = block_times(0, 2000, RATE), np.zeros(2000)
    far = Reference(DISPLACEMENT, block_times(1, 2000, RATE), np.full(2000, 1.0))
    command = loop.step(far, Feedback(time, zero, zero, zero))
    assert command.max() == pytest.approx(100.0 / 16.0)
    assert np.max(np.diff(command)) <= STEP / 16.0 * (1.0 + 1e-9)
