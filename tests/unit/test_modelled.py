"""Dynamics that a control loop does not invert sample by sample: a mode is led; the sensor's lag is not the stage's."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.inverse_pi import InversePI
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.modelled import Modelled
from pzt_ros.controllers.observer_inverse import ObserverInverse
from pzt_ros.effects.mechanical_resonance import MechanicalResonance
from pzt_ros.effects.sensor_lag import SensorLag
from pzt_ros.observers.disturbance import DisturbanceObserver
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.link import Link
from pzt_ros.physics.sensor import DisplacementSensor
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.structure import Structure
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference

RATE, FREQUENCY = 20e3, 100.0
MODE = Structure(resonance_frequency=1000.0, damping_ratio=0.02)
BESIDE = MechanicalResonance(share=0.9, frequency=1000.0, damping_ratio=0.02)
LAG = SensorLag(lag=1e-4, delay_share=0.0)
CERAMIC = (Front(), Electrostriction())


def sine(count: int) -> Array:
    """A stroke of 4 um from 3 um on, that begins smoothly [m]."""
    t = np.arange(1, count + 1) / RATE
    grown = np.minimum(t / 0.02, 1.0) ** 2 * (3.0 - 2.0 * np.minimum(t / 0.02, 1.0))
    wave: Array = 3e-6 + 2e-6 * grown * (1.0 - np.cos(2.0 * np.pi * FREQUENCY * t))
    return wave


def followed(controller: Controller, *links: Link, size: int = 1) -> tuple[Array, Array]:
    """Reference and true displacement of a stage that is its model, without its first half [m each]."""
    model = Chain("model", (*CERAMIC, *links))
    loop = ControlLoop(model, {controller.kind: controller}, Rest(), active=controller.kind)
    observer = DisturbanceObserver(gain=300.0)
    watched, state = observer.init(model, Rest()), model.init(Rest())
    up = np.linspace(0.0, 120.0, 600)
    voltages = np.concatenate((up, up[::-1] * 0.6 + 20.0 * (1.0 - up[::-1] / 120.0), np.full(400, 20.0)))
    times = np.arange(1, voltages.size + 1) / RATE
    state, out = model.step(state, Signals(times, voltages))
    watched, seen = observer.update(model, watched, times, voltages, out.displacement)
    last = slice(-1, None)
    feedback = Feedback(times[last], voltages[last], out.displacement[last], seen.displacement[last])
    loop.follow(times, voltages)
    loop.step(Reference(VOLTAGE, times[last], voltages[last]), feedback)
    begin = float(out.displacement[-1])
    move = begin + (3e-6 - begin) * 0.5 * (1.0 - np.cos(np.pi * np.arange(1, 1001) / 1000))
    reference = np.concatenate((move, np.full(1000, 3e-6), sine(1600)))
    truth, actuator = [], len(CERAMIC) + sum(link.section == "actuator" for link in links)
    stage, moving = Chain("stage", model.links[:actuator]), state[:actuator]
    for part in reference.reshape(-1, size):
        now = float(feedback.time[-1]) + np.arange(1, size + 1) / RATE
        voltage = loop.step(Reference(DISPLACEMENT, now, part), feedback)
        moving, moved = stage.step(moving, Signals(now, voltage))
        state, out = model.step(state, Signals(now, voltage))
        watched, seen = observer.update(model, watched, now, voltage, out.displacement)
        feedback = Feedback(now, voltage, out.displacement, seen.displacement)
        truth.append(moved.displacement)
    scan = slice(-800, None)
    return reference[scan], np.concatenate(truth)[scan]


@pytest.mark.parametrize("size", [1, 20])
@pytest.mark.parametrize("mode", [MODE, BESIDE])
def test_a_mode_is_led_without_ringing(mode: Link, size: int) -> None:
    reference, truth = followed(Inverse(), mode, size=size)
    assert np.max(np.abs(truth - reference)) < 2e-3 * 4e-6


@pytest.mark.parametrize("controller", [Inverse(), InversePI(integral_gain=300.0), ObserverInverse()])
@pytest.mark.parametrize("lag", [LAG, DisplacementSensor(bandwidth=1600.0)])
def test_the_stage_follows_not_the_sensor_that_lags(controller: Controller, lag: Link) -> None:
    """The lag is 8 % of the stroke at 100 Hz: by that the stage would be ahead if the reading followed."""
    reference, truth = followed(controller, lag)
    assert np.max(np.abs(truth - reference)) < 2e-3 * 4e-6


def test_all_of_them_together() -> None:
    reference, truth = followed(ObserverInverse(), MODE, LAG)
    assert np.max(np.abs(truth - reference)) < 2e-3 * 4e-6


def test_a_model_without_such_dynamics_is_taken_as_it_is() -> None:
    model = Chain("model", (*CERAMIC, DisplacementSensor(offset=1e-7)))
    modelled, reference = Modelled(model, Rest()), np.linspace(0.0, 1e-6, 5)
    time, voltage = np.arange(1.0, 6.0) / RATE, np.linspace(0.0, 10.0, 5)
    assert modelled.chain.links == model.links
    assert modelled.led(time, reference) is reference
    assert modelled.reading_of(time, reference) is reference
    modelled.follow(time, voltage)
    _, seen = model.step(model.init(Rest()), Signals(time, voltage))
    np.testing.assert_array_equal(modelled.predicted, seen.displacement)


def test_it_follows_each_block_once() -> None:
    modelled = Modelled(Chain("model", (*CERAMIC, MODE, LAG)), Rest())
    time, voltage = np.arange(1.0, 6.0) / RATE, np.linspace(0.0, 10.0, 5)
    modelled.follow(time, voltage)
    kept, seen = modelled.state, modelled.predicted
    modelled.follow(time, voltage)
    assert modelled.state is kept
    assert modelled.predicted is seen
    assert dataclasses.replace(LAG, lag=0.0) in modelled.chain.links
