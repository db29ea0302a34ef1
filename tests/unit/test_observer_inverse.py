"""The observer-based inverse where its error has a closed form: a model off by a constant, by a slope."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.observer_inverse import ObserverInverse
from pzt_ros.observers.disturbance import DisturbanceObserver
from pzt_ros.observers.hysteresis import HysteresisObserver
from pzt_ros.observers.observer import Observer
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference, block_times

RATE, SIZE = 20e3, 20
PLANT = load_chain("thesis-p2").behind_amplifier


def off_by(coefficient: float) -> Chain:
    """The plant's model with another strain coefficient."""
    *before, strain = PLANT.links
    return Chain("model", (*before, dataclasses.replace(strain, coefficient=coefficient * strain.coefficient)))


def run(controller: Inverse | ObserverInverse, model: Chain, observer: Observer, drift: float = 0.0) -> np.ndarray:
    """Error of a 5 Hz sine after poling, sensor offset by 2 um and drifting [m, shape (n,)]; the last second."""
    loop = ControlLoop(model, {controller.kind: controller}, Rest(), active=controller.kind)
    state, seen = PLANT.init(Rest()), observer.init(model, Rest())
    poling = np.concatenate((np.linspace(0, 150, 2000), np.linspace(150, 60, 1000)))
    voltage, errors = np.zeros(SIZE), []
    feedback = Feedback(voltage, voltage, voltage, voltage)
    for block in range((poling.size + 30_000) // SIZE):
        time = block_times(block, SIZE, RATE)
        if block * SIZE < poling.size:
            reference = Reference(VOLTAGE, time, poling[block * SIZE : (block + 1) * SIZE])
        else:
            reference = Reference(DISPLACEMENT, time, 8e-6 + 1.5e-6 * np.sin(2 * np.pi * 5.0 * time))
        if block:
            voltage = loop.step(reference, feedback)
        state, out = PLANT.step(state, Signals(time, voltage))
        reading = out.displacement + 2e-6 + drift * time
        seen, estimate = observer.update(model, seen, time, voltage, reading)
        feedback = Feedback(time, voltage, reading, estimate.displacement)
        errors.append(reference.values - reading)
    return np.concatenate(errors)[-20_000:]


@pytest.mark.parametrize(
    "observer", [DisturbanceObserver(gain=300.0), HysteresisObserver(members=1.0)], ids=lambda o: o.kind
)
def test_an_offset_and_a_drift_are_taken_out(observer: Observer) -> None:
    """The inverse alone is off by all of the offset; with the observer by the drift over its gain, and a block."""
    alone = run(Inverse(), PLANT, observer, drift=1e-7)
    based = run(ObserverInverse(), PLANT, observer, drift=1e-7)
    assert np.min(np.abs(alone)) > 1.9e-6
    assert np.max(np.abs(based)) < 1e-7 * (SIZE / RATE + 1.0 / 300.0) + 2e-9


def test_the_error_of_a_wrong_model_falls_with_the_gain() -> None:
    """A disturbance of angular frequency w is left at w/L and a block of delay of it, for L well above w."""
    rms = []
    for gain in (300.0, 900.0):
        error = run(ObserverInverse(), off_by(1.1), DisturbanceObserver(gain=gain))
        rms.append(float(np.std(error)))
    delay = SIZE / RATE  # half a block on the way in, half on the way out
    expected = [0.1 * 1.5e-6 / np.sqrt(2.0) * 2 * np.pi * 5.0 * (1.0 / gain + delay) for gain in (300.0, 900.0)]
    np.testing.assert_allclose(rms, expected, rtol=0.35)
    assert rms[1] < 0.6 * rms[0]


def test_the_disturbance_counts_up_to_its_limit() -> None:
    limited = ObserverInverse(disturbance_limit=0.5e-6)
    error = run(limited, PLANT, DisturbanceObserver(gain=300.0))
    np.testing.assert_allclose(error, -1.5e-6, rtol=0, atol=2e-8)
