"""The receding-horizon controller: the inverse where no limit holds, the limits where they do."""

from __future__ import annotations

import dataclasses
import threading

import numpy as np
import pytest

from pzt_ros.chains import load_chain
from pzt_ros.controllers import receding_horizon
from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.controllers.inverse_pi import InversePI
from pzt_ros.controllers.ladder import HOLD, INVERSE, NO_PLAN, PLAN, RAMP, SHIFTED, Plan
from pzt_ros.controllers.receding_horizon import Block, RecedingHorizon
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.reference import block_times

RATE, SIZE, AREA = 20e3, 50, 2e-3


class Loop:
    """A controller on a stage that is its model, block by block, with no other limits between."""

    def __init__(self, controller: Controller, chain: str = "thesis-p2", **bounds: float) -> None:
        self.controller = controller
        self.bounds = Bounds(**bounds)
        self.model: Chain = load_chain(chain).section(ACTUATOR)
        self.state = self.model.init(Rest())
        self.block = 0
        self.voltages: list[Array] = []
        self.polarizations: list[Array] = []
        self.feedback = self._apply(np.zeros(SIZE), None)
        poling = [np.linspace(0, 150, 8 * SIZE), np.linspace(150, 30, 8 * SIZE), np.full(4 * SIZE, 30.0)]
        for part in np.concatenate(poling).reshape(-1, SIZE):
            self.feedback = self._apply(part, None)
        self.begun = len(self.voltages)
        self.held = controller.init(self.model, self.feedback)

    def _apply(self, voltage: Array, reference: Array | None) -> Feedback:
        time = block_times(self.block, SIZE, RATE)
        self.state, out = self.model.step(self.state, Signals(time, voltage))
        self.block += 1
        self.voltages.append(voltage)
        self.polarizations.append(out.polarization)
        y = out.displacement
        return Feedback(time, voltage, y, y, reference, self.state, y, bounds=self.bounds)

    def run(self, moves: Array) -> Array:
        """Follow displacements [m] relative to where it stands; returns the error [m]."""
        begin = float(self.feedback.measurement[-1])
        errors = []
        for part in begin + moves.reshape(-1, SIZE):
            time = block_times(self.block, SIZE, RATE)
            self.held, voltage = self.controller.step(self.model, self.held, time, part, self.feedback)
            self.feedback = self._apply(voltage, part)
            errors.append(part - self.feedback.measurement)
        return np.concatenate(errors)

    @property
    def voltage(self) -> Array:
        """Since the controller took over, and one sample before [V]."""
        return np.concatenate([self.voltages[self.begun - 1][-1:], *self.voltages[self.begun :]])

    @property
    def current(self) -> Array:
        """Mean current of every sample since then [A]."""
        return (
            AREA
            * RATE
            * np.diff(np.concatenate([self.polarizations[self.begun - 1][-1:], *self.polarizations[self.begun :]]))
        )


class WithoutSolver(RecedingHorizon):
    """Its solver finds nothing, in the tick or in the background: the inverse is left."""

    def _answer(self, model: Chain, block: Block, wanted: Array, plan: Plan) -> tuple[str, Array]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(receding_horizon, "optimal_block", lambda *_: None)
            return super()._answer(model, block, wanted, NO_PLAN)


STEP = np.concatenate([np.zeros(SIZE), np.full(6 * SIZE, 5e-6), np.full(6 * SIZE, -1e-6)])


def test_without_an_active_limit_it_is_the_inverse() -> None:
    time = np.arange(20 * SIZE) / RATE
    moves = 2e-6 * (1.0 - np.cos(2 * np.pi * 50 * time))
    ours, theirs = Loop(RecedingHorizon()), Loop(InversePI())
    ours.run(moves)
    theirs.run(moves)
    np.testing.assert_array_equal(ours.voltage, theirs.voltage)


def test_the_current_limit_is_kept_where_the_inverse_leaves_it() -> None:
    ours, theirs = Loop(RecedingHorizon()), Loop(InversePI())
    error, _ = ours.run(STEP), theirs.run(STEP)
    assert np.max(np.abs(theirs.current)) > 0.25, "or this tests nothing"
    assert np.max(np.abs(ours.current)) < 0.2 * 1.01
    assert np.max(np.abs(error[6 * SIZE : 7 * SIZE])) < 0.1e-6
    assert np.max(np.abs(error[-SIZE:])) < 0.1e-6


@pytest.mark.parametrize("slew", [2e4, 2e5])
def test_with_a_slew_limit_the_plan_is_better_than_the_inverse_held_in_it(slew: float) -> None:
    planned, held = (Loop(cls(current=10.0), slew_rate=slew) for cls in (RecedingHorizon, WithoutSolver))
    errors = [float(np.sum(loop.run(STEP) ** 2)) for loop in (planned, held)]
    assert errors[0] <= errors[1]
    assert np.max(np.abs(np.diff(planned.voltage))) <= slew / RATE * (1 + 1e-9)


def test_nothing_that_is_asked_leaves_the_limits() -> None:
    rng = np.random.default_rng(4)
    controller = RecedingHorizon()
    loop = Loop(controller, voltage_max=120.0, voltage_min=-20.0, slew_rate=1e5)
    for _ in range(12):
        kind = rng.integers(4)
        moves = rng.uniform(-20e-6, 20e-6) * np.ones(2 * SIZE)
        if kind == 1:
            moves = 10e-6 * rng.normal(size=2 * SIZE)
        elif kind == 2:
            moves[rng.integers(2 * SIZE)] = rng.choice([np.nan, np.inf, 1e300])
        elif kind == 3:
            moves = np.linspace(0.0, rng.uniform(-15e-6, 15e-6), 2 * SIZE)
        with np.errstate(all="ignore"):
            loop.run(moves)
        loop.controller = dataclasses.replace(controller, integral_gain=float(10 ** rng.uniform(0, 3)))
    voltage = loop.voltage
    assert np.all(np.isfinite(voltage))
    assert np.max(voltage) <= 120.0 + 1e-9
    assert np.min(voltage) >= -20.0 - 1e-9
    assert np.max(np.abs(np.diff(voltage))) <= 1e5 / RATE * (1 + 1e-9)


@pytest.mark.parametrize("chain", ["thesis-q1", "thesis-p3"])
def test_every_ceramic_is_served(chain: str) -> None:
    loop = Loop(RecedingHorizon(), chain, slew_rate=3e4)
    error = loop.run(np.concatenate([np.zeros(SIZE), np.full(6 * SIZE, 1.5e-6)]))
    assert np.max(np.abs(np.diff(loop.voltage))) <= 3e4 / RATE * (1 + 1e-9)
    assert np.max(np.abs(error[-SIZE:])) < 0.1e-6


def answers(loop: Loop, *parts: Array) -> list[str]:
    """The rung of each block."""
    found = []
    for part in parts:
        loop.run(part)
        found.append(loop.held.rung)
    return found


SMALL, LARGE, NOTHING = np.full(SIZE, 1e-8), np.full(SIZE, 5e-6), np.full(SIZE, np.nan)


def test_the_answer_is_the_plan_with_and_without_an_active_limit() -> None:
    assert answers(Loop(RecedingHorizon()), SMALL, SMALL, LARGE, LARGE) == [PLAN] * 4


def test_a_reference_without_numbers_is_bridged_by_the_previous_plan_then_held_then_lowered() -> None:
    controller = RecedingHorizon(horizon=2.0, hold_time=1.5 * SIZE / RATE, ramp_rate=1e3)
    loop = Loop(controller)
    begun = answers(loop, SMALL, SMALL)
    rungs = answers(loop, *[NOTHING] * 6)
    assert (begun, rungs) == ([PLAN, PLAN], [SHIFTED, SHIFTED, HOLD, RAMP, RAMP, RAMP])
    voltage = loop.voltage
    assert np.all(np.isfinite(voltage))
    fall = np.diff(voltage[-2 * SIZE :])
    np.testing.assert_allclose(fall, -1e3 / RATE, rtol=1e-6)
    assert answers(loop, SMALL)[0] in (PLAN, INVERSE), "and it comes back when there is a reference again"


def test_the_ramp_ends_at_zero() -> None:
    loop = Loop(RecedingHorizon(hold_time=0.0, ramp_rate=1e5))
    answers(loop, *[NOTHING] * 4)
    np.testing.assert_array_equal(loop.voltage[-SIZE:], 0.0)


@pytest.mark.parametrize("found", [None, np.full(SIZE, np.nan), np.full(SIZE, np.inf)])
def test_without_a_solution_it_is_the_previous_plan_and_without_that_the_inverse(
    found: Array | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The solver fails from here on; the plan that looked two blocks ahead before is used up first."""
    loop = Loop(RecedingHorizon(horizon=2.0, current=0.1))
    assert answers(loop, SMALL, SMALL) == [PLAN, PLAN]
    loop.held.solving.result()
    monkeypatch.setattr(receding_horizon, "optimal_block", lambda *_: found)
    assert answers(loop, *[LARGE] * 3) == [SHIFTED, SHIFTED, INVERSE]
    assert np.all(np.isfinite(loop.voltage))


def test_a_plan_that_is_late_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """The background takes seconds; the tick goes on with what there is."""
    gate = threading.Event()
    look_ahead = RecedingHorizon._look_ahead

    def slow(self: RecedingHorizon, model: Chain, block: Block, voltage: Array) -> Plan | None:
        gate.wait(10.0)
        return look_ahead(self, model, block, voltage)

    monkeypatch.setattr(RecedingHorizon, "_look_ahead", slow)
    try:
        loop = Loop(RecedingHorizon(patience=1e-3))
        assert answers(loop, SMALL, LARGE, LARGE) == [PLAN] * 3
        assert loop.held.plan is NO_PLAN
        assert answers(loop, NOTHING) == [HOLD]
    finally:
        gate.set()


def test_in_lock_step_a_run_repeats_to_the_bit() -> None:
    first, second = Loop(RecedingHorizon(), slew_rate=5e4), Loop(RecedingHorizon(), slew_rate=5e4)
    first.run(STEP)
    second.run(STEP)
    np.testing.assert_array_equal(first.voltage, second.voltage)
