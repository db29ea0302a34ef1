"""Controllers against what one can compute by hand: a recursion, a straight line, a model that is the plant."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers.controller import NEVER, Controller, Feedback, tracking_error
from pzt_ros.controllers.inverse import Inverse
from pzt_ros.controllers.inverse_pi import InversePI
from pzt_ros.controllers.loop import ControlLoop
from pzt_ros.controllers.open_loop import OpenLoop
from pzt_ros.controllers.pi import PI, proportional_integral, sample_period
from pzt_ros.controllers.table import CONTROLLERS
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR, SENSOR
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.reference import DISPLACEMENT, VOLTAGE, Reference, block_times
from pzt_ros.scenario import load_scenario

RATE, SIZE = 20e3, 100
NO_MODEL = Chain("none", ())


def feedback_of(error: np.ndarray, voltage: float = 10.0) -> Feedback:
    """Feedback with a given tracking error [m]."""
    measurement = np.full(error.size, 3e-6)
    time = block_times(0, error.size, RATE)
    return Feedback(time, np.full(error.size, voltage), measurement, measurement, measurement + error)


def by_hand(error: np.ndarray, start: float, kp: float, ki: float, limit: float) -> list[float]:
    """PI as it stands in a textbook, sample by sample."""
    integral, out = start, []
    for e in error:
        integral = min(max(integral + ki / RATE * e, -limit), limit)
        out.append(kp * e + integral)
    return out


def test_pi_is_the_recursion_of_the_textbook() -> None:
    pi = PI(proportional_gain=2e6, integral_gain=4e8, integral_limit=10.3)
    errors = 1e-6 * np.random.default_rng(3).normal(size=(5, SIZE))
    errors[2] += 5e-6  # drives the integral into its limit
    state = pi.init(NO_MODEL, feedback_of(errors[0]))
    assert state == 10.0, "the integral continues the voltage found"
    voltages = []
    for block, error in enumerate(errors):
        time = block_times(block + 1, SIZE, RATE)
        state, voltage = pi.step(NO_MODEL, state, time, np.zeros(SIZE), feedback_of(error))
        voltages.append(voltage)
    expected = by_hand(errors.ravel(), 10.0, 2e6, 4e8, 10.3)
    np.testing.assert_allclose(np.concatenate(voltages), expected, rtol=1e-9)
    assert np.max(np.array(expected) - 2e6 * errors.ravel()) == pytest.approx(10.3), "it did reach the limit"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_integral_stays_at_its_limit_and_comes_back_at_once(sign: float) -> None:
    error = sign * np.concatenate((np.ones(50), -np.ones(10)))
    integral, out = proportional_integral(error, 0.0, 0.0, 0.5, 4.0)
    np.testing.assert_allclose(out[7:50], sign * 4.0)
    np.testing.assert_allclose(out[50:], sign * (4.0 - 0.5 * np.arange(1, 11)))
    assert integral == out[-1]


def test_proportional_part_has_no_memory() -> None:
    error = np.random.default_rng(1).normal(size=20)
    integral, out = proportional_integral(error, 1.5, 3.0, 0.0, 10.0)
    np.testing.assert_allclose(out, 1.5 + 3.0 * error)
    assert integral == 1.5


def test_without_a_reference_there_is_no_error() -> None:
    feedback = dataclasses.replace(feedback_of(np.ones(SIZE)), reference=None)
    np.testing.assert_array_equal(tracking_error(feedback), np.zeros(SIZE))
    np.testing.assert_allclose(tracking_error(feedback_of(np.full(SIZE, 2e-7))), 2e-7)
    assert sample_period(block_times(7, SIZE, RATE)) == pytest.approx(1 / RATE, rel=1e-12)


def test_open_loop_is_a_straight_line() -> None:
    reference = np.linspace(0.0, 10e-6, SIZE)
    _, voltage = OpenLoop(gain=8e-8, voltage_at_zero=-20.0).step(
        NO_MODEL, None, block_times(0, SIZE, RATE), reference, feedback_of(np.zeros(SIZE))
    )
    np.testing.assert_allclose(voltage, -20.0 + reference / 8e-8, rtol=1e-12)
    assert voltage[-1] == pytest.approx(105.0)


class ModelIsPlant:
    """A control loop on a stage that is its model."""

    def __init__(self, controller: Controller, handover_time: float = 0.02) -> None:
        chain = load_chain("thesis-p2")
        self.control = ControlLoop(
            chain, {controller.kind: controller}, Rest(), active=controller.kind, handover_time=handover_time
        )
        self.stage = chain.section(ACTUATOR, SENSOR)
        self.state = self.stage.init(Rest())
        self.block = 0
        self._apply(np.zeros(SIZE))

    def _apply(self, voltage: np.ndarray) -> np.ndarray:
        time = block_times(self.block, SIZE, RATE)
        self.state, out = self.stage.step(self.state, Signals(time, voltage))
        self.feedback = Feedback(time, voltage, out.displacement, out.displacement)
        self.block += 1
        return out.displacement

    def run(self, quantity: str, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Voltage [V] and displacement [m] while following a reference."""
        voltages, displacements = [], []
        for part in values.reshape(-1, SIZE):
            reference = Reference(quantity, block_times(self.block, SIZE, RATE), part)
            voltages.append(self.control.step(reference, self.feedback))
            displacements.append(self._apply(voltages[-1]))
        return np.concatenate(voltages), np.concatenate(displacements)

    def pole(self) -> float:
        """To 150 V and back to 60 V; where it is then [m]."""
        self.run(VOLTAGE, np.concatenate((np.linspace(0, 150, 2000), np.linspace(150, 60, 1000), np.full(100, 60.0))))
        return float(self.feedback.measurement[-1])


@pytest.mark.parametrize("controller", [Inverse(), InversePI()], ids=lambda c: c.kind)
def test_inverse_reaches_the_reference_on_its_own_model(controller: Controller) -> None:
    bench = ModelIsPlant(controller)
    here = bench.pole()
    time = np.arange(1, 6001) / RATE
    reference = here + 1e-6 * (1.0 - np.cos(2 * np.pi * 10.0 * time))
    voltage, displacement = bench.run(DISPLACEMENT, reference)
    settled = slice(4000, None)  # 0.2 s: what was found on taking over has faded
    assert np.max(np.abs(displacement[settled] - reference[settled])) < 1e-9
    assert np.ptp(voltage[settled]) > 5.0, "it had to work for it"


@pytest.mark.parametrize("kind", CONTROLLERS)
def test_a_restarted_controller_leaves_the_stage_where_an_operator_has_it(kind: str, tmp_path: Path) -> None:
    """It knows nothing of the past of a stage that was poled; no controller may go where its own model says."""
    file = tmp_path / "manual.yaml"
    file.write_text("{plant: bench-stage, model: thesis-p2, manual: {}}", encoding="utf-8")
    scenario = load_scenario(file)
    bench = ModelIsPlant(scenario.controllers[kind], scenario.timing.handover_time)
    bench.pole()
    bench.run(VOLTAGE, np.concatenate((np.linspace(60, 0, 1000), np.zeros(4000))))  # and disabled for a while
    chain = load_chain("thesis-p2")
    bench.control = ControlLoop(chain, scenario.controllers, Rest(), kind, scenario.timing.handover_time)
    here = bench.feedback.measurement[-1]
    _, displacement = bench.run(DISPLACEMENT, np.full(10000, here))
    assert np.max(np.abs(displacement - here)) < 0.1e-6  # with a line of its own the open loop went 3 um away


def test_a_voltage_is_what_is_asked_however_long_an_offset_stays() -> None:
    bench = ModelIsPlant(OpenLoop(), NEVER)
    bench.pole()
    bench.run(DISPLACEMENT, np.full(1000, bench.feedback.measurement[-1]))
    voltage, _ = bench.run(VOLTAGE, np.full(2000, 20.0))
    np.testing.assert_array_equal(voltage[1100:], 20.0)


def test_hand_over_fades_to_nothing() -> None:
    """From 60 V to the line of the open loop: half a cosine over the hand-over time, then the line alone."""
    line = OpenLoop(gain=1e-7)
    bench = ModelIsPlant(line, handover_time=0.02)
    bench.pole()
    voltage, _ = bench.run(DISPLACEMENT, np.full(600, 8e-6))
    since = np.arange(1, 601) / RATE
    weight = np.where(since < 0.02, 0.5 * (1.0 + np.cos(np.pi * since / 0.02)), 0.0)
    np.testing.assert_allclose(voltage, 80.0 + (60.0 - 80.0) * weight, rtol=0, atol=1e-9)
    np.testing.assert_allclose(voltage[401:], 80.0, rtol=1e-15)


def test_unknown_controller_is_named() -> None:
    bench = ModelIsPlant(OpenLoop())
    with pytest.raises(BenchError, match="controller 'pid' is unknown; known are open_loop"):
        bench.control.select("pid")
    assert bench.control.active == "open_loop"


def test_other_gains_come_into_force_with_the_next_block() -> None:
    bench = ModelIsPlant(OpenLoop(gain=1e-7), handover_time=1e-3)
    bench.run(DISPLACEMENT, np.full(2 * SIZE, 1e-6))
    bench.control.replace(OpenLoop(gain=2e-7))
    voltage, _ = bench.run(DISPLACEMENT, np.full(SIZE, 1e-6))
    np.testing.assert_allclose(voltage, 5.0, rtol=1e-12)
