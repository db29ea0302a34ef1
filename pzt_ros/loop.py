"""The closed loop in one process, without ROS: the same objects in the same order as the graph.

A test holds the two together, sample for sample. Use it to tune, to benchmark, and wherever a 20 kHz loop must not
cross processes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pzt_ros.chains import load_chain, load_model
from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.feasible import Forecast, forecast, require
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.errors import RunFailedError
from pzt_ros.hardware.amplifier import Applied, SimulatedAmplifier
from pzt_ros.hardware.guard import GuardedAmplifier
from pzt_ros.hardware.stage import SimulatedSensor, SimulatedStage, Truth
from pzt_ros.manual import conductor
from pzt_ros.observers.observer import Estimate
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.reference import VOLTAGE, Reference
from pzt_ros.scenario import Scenario


@dataclass(frozen=True)
class Tick:
    """All that was said on the topics for one block."""

    reference: Reference | None
    command_voltage: Array | None
    applied: Applied
    truth: Truth
    measurement: Array
    estimate: Estimate


class InProcessLoop:
    """Every library object of the graph, stepped block by block."""

    def __init__(self, scenario: Scenario) -> None:
        plant, model = load_chain(scenario.plant), load_model(scenario.model)
        rest = Rest(seed=scenario.seed)
        self.amplifier = GuardedAmplifier(
            SimulatedAmplifier(plant, rest), scenario.limits, scenario.sample_rate, scenario.block_size
        )
        self.stage = SimulatedStage(plant, rest)
        self.sensor = SimulatedSensor(plant, rest)
        self.model = model
        self.observer = scenario.observer
        self._observer_state = self.observer.init(model, rest)
        self.control = ControlLoop(
            model,
            scenario.controllers,
            rest,
            handover_time=scenario.timing.handover_time,
            bounds=scenario.bounds,
        )
        self.experiment = conductor(scenario)

    def warm_up(self) -> None:
        """Compile now what the first block would have to wait for; no state is changed."""
        for part in (self.amplifier, self.stage, self.sensor, self.control):
            part.warm_up()
        self.observer.warm_up(self.model, self._observer_state)

    def start(self) -> Tick:
        """The first block: the voltage found at the stack, held."""
        self.amplifier.enable()
        return self._measure(None, None, self.amplifier.hold())

    def step(self, last: Tick) -> Tick | None:
        """The next block, or None when the scenario is over.

        Raises:
            RunFailedError: the amplifier refused the command, or is in fault.
        """
        self.experiment.observe(last.applied.time, last.applied.voltage)
        reference = self.experiment.step(
            self.amplifier.next_block, float(last.measurement.mean()), float(last.applied.voltage[-1])
        )
        if reference is None:
            return None
        if reference.controller:
            self.control.select(reference.controller)
        feedback = Feedback(last.applied.time, last.applied.voltage, last.measurement, last.estimate.displacement)
        command = self.control.step(reference, feedback)
        applied = self.amplifier.apply(float(reference.time[0]), command)
        if applied is None:
            amplifier = self.amplifier
            why = amplifier.reason or ", ".join(amplifier.counts)
            raise RunFailedError(
                f"at {reference.time[0]:.4f} s the amplifier took no command, it is {amplifier.state}: {why}"
            )
        return self._measure(reference, command, applied)

    def _measure(self, reference: Reference | None, command: Array | None, applied: Applied) -> Tick:
        truth = self.stage.step(applied.time, applied.voltage)
        measurement = self.sensor.read(truth.time, truth.displacement)
        self._observer_state, estimate = self.observer.update(
            self.model, self._observer_state, applied.time, applied.voltage, measurement, applied.charge
        )
        return Tick(reference, command, applied, truth, measurement, estimate)


def foresee(scenario: Scenario) -> list[Forecast]:
    """What the model makes of each displacement phase of a scenario, within the limits of the amplifier.

    Raises:
        BenchError: a reference that is not finite.
    """
    model, rest = load_model(scenario.model).behind_amplifier, Rest(seed=scenario.seed)
    state, experiment, block, found = model.init(rest), scenario.experiment(), 1, []
    time, displacement, voltage = 0.0, 0.0, rest.voltage
    while (phase := experiment.phase) is not None:
        parts = []
        while experiment.phase is phase:
            parts.append(experiment.step(block, displacement, voltage))
            block += 1
        times = np.concatenate([part.time for part in parts if part])
        values = np.concatenate([part.values for part in parts if part])
        if phase.quantity == VOLTAGE:
            state, out = model.step(state, Signals(times, values))
            displacement, voltage = float(out.displacement[-1]), float(values[-1])
        else:
            asked = Signals(times, displacement=values)
            limits = scenario.limits.current
            found.append(forecast(model, state, asked, scenario.bounds, last=(time, voltage), current=limits))
            state = found[-1].state
            displacement, voltage = float(found[-1].displacement[-1]), float(found[-1].voltage[-1])
        time = float(times[-1])
    return found


def refuse_what_cannot_be(scenario: Scenario) -> None:
    """Refuse a scenario that asks for more stroke, slew or current than there is, before anything moves.

    Raises:
        BenchError: with the phase's reason, the error to be expected, and what to do.
    """
    for found in foresee(scenario):
        require(found)


def run_in_process(scenario: Scenario, watch: Callable[[Tick], None]) -> None:
    """Run a scenario to its end; `watch` sees every tick, so that memory stays with the caller."""
    loop = InProcessLoop(scenario)
    tick: Tick | None = loop.start()
    while tick is not None:
        watch(tick)
        tick = loop.step(tick)
