"""One battery for every controller: whoever stands in the table of controllers is tested here, unasked."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import math

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.hardware.guard import Limits
from pzt_ros.physics.amplifier import Amplifier
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR, SENSOR
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameters_of, to_si
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference, block_times

RATE, SIZE = 20e3, 50
HANDOVER = 0.01
SLEW_STEP = Limits().slew_rate / RATE
FADED = 200.0 * (math.pi / (RATE * HANDOVER) / 2.0) ** 2
"""In its first sample a hand-over fades by (pi dt / 2 T)^2 of the jump, and no jump exceeds 200 V [V]."""


@pytest.fixture(params=CONTROLLERS.values(), ids=CONTROLLERS.keys())
def controller(request: pytest.FixtureRequest) -> Controller:
    """One controller after the other, with its default gains."""
    return request.param()


class Bench:
    """A control loop on a stage that is its model, with nothing between."""

    def __init__(self, gain: float = 1.0) -> None:
        plain = load_chain("thesis-p2")
        model = dataclasses.replace(plain, links=(Amplifier(gain=gain), *plain.links))
        self.control = ControlLoop(
            model, {kind: cls() for kind, cls in CONTROLLERS.items()}, Rest(), handover_time=HANDOVER
        )
        self.stage: Chain = model.section(ACTUATOR, SENSOR)
        self.state = self.stage.init(Rest())
        self.block = 0
        self.feedback = self._apply(np.zeros(SIZE))

    def _apply(self, voltage: np.ndarray) -> Feedback:
        time = block_times(self.block, SIZE, RATE)
        self.state, out = self.stage.step(self.state, Signals(time, voltage))
        self.block += 1
        return Feedback(time, voltage, out.displacement, out.displacement)

    def run(self, quantity: str, values: np.ndarray, controller: str = "") -> np.ndarray:
        """Follow a reference, block by block; returns the voltage [V]."""
        if controller:
            self.control.select(controller)
        voltages = []
        for part in values.reshape(-1, SIZE):
            reference = Reference(quantity, block_times(self.block, SIZE, RATE), part)
            voltages.append(self.control.step(reference, self.feedback))
            self.feedback = self._apply(voltages[-1])
        return np.concatenate(voltages)

    def pole(self) -> None:
        """To 150 V, back to 60 V, and wait there."""
        up, down, hold = np.linspace(0, 150, 10 * SIZE), np.linspace(150, 60, 10 * SIZE), np.full(2 * SIZE, 60.0)
        self.run(VOLTAGE, np.concatenate((up, down, hold)))


@pytest.fixture(scope="module")
def poled() -> Bench:
    """A bench after poling; copy it before use."""
    bench = Bench()
    bench.pole()
    return bench


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_gains_are_declared(kind: str) -> None:
    cls = CONTROLLERS[kind]
    assert cls.kind == kind
    assert cls.__doc__
    declared = parameters_of(cls)
    assert set(declared) == {f.name for f in dataclasses.fields(cls)}
    for name, parameter in declared.items():
        assert to_si(1 if parameter.unit == "1" else f"1 {parameter.unit}", parameter.unit, name) == 1.0
        assert len(parameter.description) > 5
        assert math.isfinite(parameter.lower)
        assert math.isfinite(parameter.upper)
        assert parameter.lower <= getattr(cls(), name) <= parameter.upper


def feedback_of(bench: Bench) -> Feedback:
    return dataclasses.replace(bench.feedback, reference=bench.feedback.measurement + 1e-7, model=bench.state)


def test_step_gives_a_block_and_changes_nothing(controller: Controller, poled: Bench) -> None:
    feedback = feedback_of(poled)
    state = controller.init(poled.stage, feedback)
    time = block_times(poled.block, SIZE, RATE)
    reference = feedback.measurement[-1] + np.linspace(0.0, 1e-6, SIZE)
    kept = copy.deepcopy((state, reference, feedback))
    after, voltage = controller.step(poled.stage, state, time, reference, feedback)
    assert voltage.shape == (SIZE,)
    assert voltage.dtype == np.float64
    assert np.all(np.isfinite(voltage))
    assert repr(kept) == repr((state, reference, feedback))
    np.testing.assert_array_equal(kept[1], reference)
    for before, now in zip(kept[2].model, feedback.model, strict=True):
        np.testing.assert_array_equal(before, now)
    again, same = controller.step(poled.stage, state, time, reference, feedback)
    np.testing.assert_array_equal(same, voltage)
    assert repr(again) == repr(after)


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_takes_over_from_voltage_without_a_jump(kind: str, poled: Bench) -> None:
    bench = copy.deepcopy(poled)
    hold = np.full(10 * SIZE, float(bench.feedback.measurement[-1]))
    last = float(bench.feedback.voltage[-1])
    voltage = bench.run(DISPLACEMENT, hold, kind)
    assert abs(voltage[0] - last) < FADED + 0.05  # the stage still creeps by that much
    assert np.max(np.abs(np.diff(voltage))) < SLEW_STEP


@pytest.mark.parametrize(("before", "kind"), list(itertools.permutations(CONTROLLERS, 2)))
def test_takes_over_from_another_without_a_jump(before: str, kind: str, poled: Bench) -> None:
    bench = copy.deepcopy(poled)
    hold = np.full(3 * SIZE, float(bench.feedback.measurement[-1]))
    bench.run(DISPLACEMENT, hold, before)  # not yet settled: the change falls into the hand-over before
    last = bench.feedback.voltage
    voltage = bench.run(DISPLACEMENT, hold, kind)
    still_moving = abs(float(last[-1] - last[-2]))
    assert abs(voltage[0] - last[-1]) < FADED + still_moving


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_voltage_takes_over_without_a_jump_and_then_goes_straight_through(kind: str, poled: Bench) -> None:
    bench = copy.deepcopy(poled)
    bench.run(DISPLACEMENT, np.full(4 * SIZE, float(bench.feedback.measurement[-1])), kind)
    before = float(bench.feedback.voltage[-1])
    wanted = np.linspace(20.0, 30.0, 10 * SIZE)
    voltage = bench.run(VOLTAGE, wanted)
    assert abs(voltage[0] - before) < FADED
    faded = round(HANDOVER * RATE)
    assert np.any(voltage[: faded - 1] != wanted[: faded - 1])
    np.testing.assert_array_equal(voltage[faded:], wanted[faded:])


def test_voltage_goes_straight_through_from_the_start() -> None:
    wanted = 100.0 * np.random.default_rng(1).random(3 * SIZE)
    np.testing.assert_array_equal(Bench().run(VOLTAGE, wanted), wanted)


def test_an_amplifier_with_gain_gets_less_command() -> None:
    bench = Bench(gain=27.8)
    wanted = np.linspace(0.0, 100.0, 3 * SIZE)
    np.testing.assert_allclose(bench.run(VOLTAGE, wanted), wanted / 27.8, rtol=1e-15)


def test_warm_up_leaves_no_trace(poled: Bench) -> None:
    one, other = copy.deepcopy(poled), copy.deepcopy(poled)
    other.control.warm_up()
    wanted = float(one.feedback.measurement[-1]) + np.linspace(0, 1e-6, 4 * SIZE)
    for kind in CONTROLLERS:
        np.testing.assert_array_equal(
            one.run(DISPLACEMENT, wanted, kind), other.run(DISPLACEMENT, wanted, kind), err_msg=kind
        )
