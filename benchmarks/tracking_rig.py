"""The stage, the sensor and the loop of the tracking benchmark (methods.md section 5), sample by sample."""

from __future__ import annotations

import dataclasses
import time as clock
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.observers.hysteresis import HysteresisObserver
from pzt_ros.observers.observer import Observer
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.front import Front
from pzt_ros.physics.lattice import Lattice
from pzt_ros.physics.link import Link
from pzt_ros.physics.sensor import DisplacementSensor
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.reference import DISPLACEMENT, Reference

RATE = 20e3
"""Samples per second [Hz]."""

LOW, STROKE = 0.8e-6, 10e-6
"""Of the triangle [m]."""

MOVE, SETTLE = 0.2, 0.1
"""Time to the triangle's lower end, and there [s]."""

BOUNDS = Bounds(voltage_min=-100.0, voltage_max=200.0, slew_rate=5e6)
"""Wide enough for every controller of the table; the triangle needs -45 to 150 V."""

SENSOR = DisplacementSensor(noise_rms=30e-9, resolution=0.1e-6)
"""The thesis' 0.1 um as a least step, and 30 nm of noise; sigma 42 nm together."""

WRONG = {"coercive_field": 0.525e6, "coercive_field_spread": 5.5e11, "interaction_field_spread": 4.5e11}
"""E_c + 5 %, b1 + 10 %, b2 - 10 %."""

QUIET = dataclasses.replace(SENSOR, noise_rms=0.0, resolution=0.0)


def stage(ceramic: Link, name: str) -> Chain:
    """A ceramic that moves."""
    return Chain(name, (ceramic, Electrostriction()))


PLANT = stage(Lattice(spacing=0.9, method="midpoint"), "quadrature")
FRONT = stage(Front(), "front")
LATTICE = stage(Lattice(spacing=0.8, method="midpoint", accuracy=1e-3), "lattice")
WRONG_FRONT = stage(Front(**WRONG), "front, wrong parameters")
WRONG_LATTICE = stage(Lattice(spacing=0.8, method="midpoint", accuracy=1e-3, **WRONG), "lattice, wrong parameters")
DIRECT = Chain("no amplifier", ())


def triangle(frequency: float, cycles: float) -> Array:
    """The reference [m]; its first sample comes one sample after the lower end."""
    cycle = (np.arange(1, round(cycles * RATE / frequency) + 1) * (frequency / RATE)) % 1.0
    reference: Array = LOW + STROKE * (1.0 - np.abs(1.0 - 2.0 * cycle))
    return reference


@dataclass(frozen=True)
class Tracked:
    """A run over the triangle: reference, true displacement [m], voltage [V, each of shape (n,)]; and what it took.

    Attributes:
        seconds: of control loop and observer, median over the samples [s].
    """

    reference: Array
    truth: Array
    voltage: Array
    seconds: float

    @property
    def error(self) -> Array:
        """Reference minus truth, of the stroke [%]."""
        return 100.0 * (self.reference - self.truth) / STROKE

    def settled(self, skip: int) -> tuple[float, float]:
        """Root mean square and largest error without the first `skip` samples [%]."""
        error = self.error[skip:]
        return float(np.sqrt(np.mean(error**2))), float(np.max(np.abs(error)))


@dataclass(frozen=True)
class Rig:
    """A stage that was poled, with a controller on it; blocks of one sample are one sample of delay.

    Attributes:
        controller: in charge.
        model: what it believes in.
        observer: None: the controller has the measurement in place of an estimate.
        plant: the stage.
        amplifier: that drives it.
        sensor: on it.
        seed: of the sensor's noise.
    """

    controller: Controller
    model: Chain = FRONT
    observer: Observer | None = None
    plant: Chain = PLANT
    amplifier: Chain | Link = DIRECT
    sensor: Chain | Link = field(default_factory=lambda: SENSOR)
    seed: int = 3

    def run(self, frequency: float, cycles: float) -> Tracked:
        """Pole, move to the triangle, wait, and follow it."""
        return self.follow(triangle(frequency, cycles))

    def follow(self, scan: Array) -> Tracked:
        """Pole, move to where a scan ends, wait, and follow it [m, shape (n,)]."""
        rest = Rest(seed=self.seed)
        loop = ControlLoop(
            self.model, {self.controller.kind: self.controller}, rest, active=self.controller.kind, bounds=BOUNDS
        )
        world = _World(self, rest)
        time, voltage = _poling()
        feedback = world.step(time, voltage)
        loop.follow(time, feedback.voltage)
        last = slice(-1, None)
        feedback = Feedback(time[last], feedback.voltage[last], feedback.measurement[last], feedback.estimate[last])
        here, count = float(world.truth[-1]), round(MOVE * RATE)
        part = 0.5 * (1.0 - np.cos(np.pi * np.arange(1, count + 1) / count))
        approach = np.concatenate((here + (scan[-1] - here) * part, np.full(round(SETTLE * RATE), scan[-1])))
        reference = np.concatenate((approach, scan))
        truth, voltages, took = (np.empty(reference.size) for _ in range(3))
        for k in range(reference.size):
            now = np.array([time[-1] + (k + 1) / RATE])
            began = clock.perf_counter()
            voltage = loop.step(Reference(DISPLACEMENT, now, reference[k : k + 1]), feedback)
            took[k] = clock.perf_counter() - began
            feedback = world.step(now, voltage)
            took[k] += world.observing
            truth[k], voltages[k] = world.truth[0], voltage[0]
        part_of_scan = slice(approach.size, None)
        return Tracked(reference[part_of_scan], truth[part_of_scan], voltages[part_of_scan], float(np.median(took)))


class _World:
    """Amplifier, stage, sensor and observer; remembers what was true in the last block, and the observer's time [s]."""

    def __init__(self, rig: Rig, rest: Rest) -> None:
        self.rig = rig
        self._amplifier: Any = rig.amplifier.init(rest)
        self._stage, self._sensor = rig.plant.init(rest), rig.sensor.init(rest)
        self._observer = rig.observer.init(rig.model, rest) if rig.observer else None
        self.truth = np.zeros(1)
        self.observing = 0.0

    def step(self, time: Array, voltage: Array) -> Feedback:
        """What a block of command voltage [V] comes to."""
        rig = self.rig
        self._amplifier, driven = rig.amplifier.step(self._amplifier, Signals(time, voltage))
        voltage = driven.voltage
        self._stage, out = rig.plant.step(self._stage, driven)
        self._sensor, seen = rig.sensor.step(self._sensor, out)
        self.truth = out.displacement
        if rig.observer is None:
            return Feedback(time, voltage, seen.displacement, seen.displacement)
        began = clock.perf_counter()
        self._observer, estimate = rig.observer.update(rig.model, self._observer, time, voltage, seen.displacement)
        self.observing = clock.perf_counter() - began
        return Feedback(time, voltage, seen.displacement, estimate.displacement)


def _poling() -> tuple[Array, Array]:
    """Times [s] and voltages [V]: up to 1.7 MV/m and down to 0.2 MV/m."""
    voltage = np.concatenate((np.linspace(0.0, 170.0, 4000), np.linspace(170.0, 20.0, 3000), np.full(200, 20.0)))
    return np.arange(voltage.size) / RATE, voltage


def known_start() -> Observer:
    """The hysteresis observer of a stage whose history is known: one member, and the disturbance."""
    return HysteresisObserver(members=1.0)


def loop_of(model: Chain, frequency: float) -> tuple[Array, Array]:
    """Voltage [V] and displacement [m] of a cycle of the triangle that the model itself follows exactly."""
    from pzt_ros.controllers.inverse import Inverse

    run = Rig(Inverse(), model, plant=model, sensor=QUIET).run(frequency, 2.0)
    cycle = slice(round(RATE / frequency), None)
    return run.voltage[cycle], run.truth[cycle]
