"""No controller ever commands what it must not, whatever it is asked, told, set to or switched to."""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameters_of
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference, block_times

RATE, SIZE, BLOCKS = 20e3, 20, 1000
SEEDS = range(int(os.environ.get("PZT_RANDOM_RUNS", "5")))
"""Runs of 1,000 references each; PZT_RANDOM_RUNS=100 is the long series of 1e5."""


def any_controller(random: np.random.Generator, kind: str) -> Controller:
    """With gains from anywhere within their bounds, mostly the extremes."""
    gains = {}
    for name, declared in parameters_of(CONTROLLERS[kind]).items():
        low, high = max(declared.lower, -1e6), min(declared.upper, 1e9)
        spread = low + (high - low) * 10.0 ** random.uniform(-9.0, 0.0)
        gains[name] = float(random.choice([low, high, spread, getattr(CONTROLLERS[kind](), name)]))
    if kind == "learning":  # a period of a few blocks, or nothing is ever learned
        gains["period"] = float(random.choice([2e-3, 5e-3, 20e-3, 1.0]))
    return CONTROLLERS[kind](**gains)


def any_reference(random: np.random.Generator, here: float) -> np.ndarray:
    """Steps, ramps, noise, scans, what is far out of reach, and what is no number [m]."""
    kind = random.integers(7)
    if kind == 0:
        return np.full(SIZE, random.uniform(0.0, 12e-6))
    if kind == 1:
        return np.linspace(here, random.uniform(0.0, 12e-6), SIZE)
    if kind == 2:
        return random.normal(6e-6, 1e-6, SIZE)
    if kind == 3:
        return 6e-6 + 2e-6 * np.sin(2.0 * np.pi * np.arange(SIZE) / SIZE)
    if kind == 4:
        return np.full(SIZE, 10.0 ** random.uniform(-6.0, 300.0) * random.choice([-1.0, 1.0]))
    values = np.full(SIZE, 6e-6)
    values[random.integers(SIZE)] = random.choice([np.nan, np.inf, -np.inf])
    return values


def spoilt(random: np.random.Generator, values: np.ndarray) -> np.ndarray:
    """Readings with spikes and holes."""
    values = values + 3e-8 * random.normal(size=values.size)
    if random.random() < 0.2:
        values[random.integers(values.size)] = random.choice([np.nan, np.inf, -np.inf, 1e-3, -1e300])
    if random.random() < 0.02:
        values[:] = np.nan
    return values


@pytest.mark.parametrize("seed", SEEDS)
def test_always_a_number_within_window_and_slew(seed: int) -> None:
    random = np.random.default_rng(seed)
    gain = float(random.choice([1.0, 16.0]))
    bounds = Bounds(voltage_min=-30.0, voltage_max=140.0, slew_rate=float(10.0 ** random.uniform(3.0, 6.0)))
    plain = load_chain("thesis-p2")
    model = dataclasses.replace(plain, links=(Amplifier(gain=gain), *plain.links))
    controllers = {kind: cls() for kind, cls in CONTROLLERS.items()}
    loop = ControlLoop(model, controllers, Rest(), handover_time=0.01, bounds=bounds)
    stage = model.behind_amplifier
    state, last, feedback = stage.init(Rest()), 0.0, None
    voltage = np.zeros(SIZE)
    with np.errstate(all="ignore"):  # 1e300 m squared is infinite; what counts is what comes out
        for block in range(BLOCKS):
            time = block_times(block, SIZE, RATE)
            if feedback is not None:
                if random.random() < 0.05:
                    loop.select(str(random.choice(list(CONTROLLERS))))
                if random.random() < 0.1:
                    loop.replace(any_controller(random, loop.active))
                if random.random() < 0.02:
                    asked = Reference(VOLTAGE, time, np.full(SIZE, last))  # a hold by voltage, then another source
                else:
                    asked = Reference(DISPLACEMENT, time, any_reference(random, feedback.measurement[-1]))
                voltage = gain * loop.step(asked, feedback)
                assert np.all(np.isfinite(voltage)), (loop.active, block)
                if asked.quantity == DISPLACEMENT:
                    slack = 1e-9 * (1.0 + abs(last))
                    assert voltage.min() >= bounds.voltage_min - slack, (loop.active, block)
                    assert voltage.max() <= bounds.voltage_max + slack, (loop.active, block)
                    steps = np.abs(np.diff(voltage, prepend=last))
                    assert steps.max() <= bounds.slew_rate / RATE + slack, (loop.active, block)
            state, out = stage.step(state, Signals(time, voltage))
            last = float(voltage[-1])
            reading = spoilt(random, out.displacement)
            feedback = Feedback(time, voltage, reading, out.displacement if random.random() < 0.9 else reading)
    assert loop.limited > BLOCKS, "the bounds had to do something"


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_every_controller_comes_back_from_the_bounds(kind: str) -> None:
    """A reference far out of reach for 50 ms; then one within reach is followed, with nothing wound up.

    Beside the same run without the excursion: half a second later nothing of it is left.
    """
    ends = []
    for excursion in (0.0, 30e-6):
        model = load_chain("thesis-p2").behind_amplifier
        loop = ControlLoop(model, {kind: CONTROLLERS[kind]()}, Rest(), active=kind, bounds=Bounds(slew_rate=5e3))
        state, voltage, displacement = model.init(Rest()), np.linspace(0.0, 60.0, SIZE * 20), 0.0
        feedback = Feedback(np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1))
        for block in range(820):
            time = block_times(block, SIZE, RATE)
            part = voltage[block * SIZE : (block + 1) * SIZE]
            if block >= 20:
                reference = np.full(SIZE, 5e-6 + (excursion if 220 <= block < 270 else 0.0))
                part = loop.step(Reference(DISPLACEMENT, time, reference), feedback)
            state, out = model.step(state, Signals(time, part))
            feedback = Feedback(time, part, out.displacement, out.displacement)
            displacement = float(out.displacement[-1])
        ends.append(displacement)
    assert math.isfinite(ends[1])
    if kind != "open_loop":  # which cannot know that the stage came back along another branch
        assert abs(ends[1] - 5e-6) < 5e-8 + 2.0 * abs(ends[0] - 5e-6), ends
