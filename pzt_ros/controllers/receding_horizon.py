"""Receding-horizon optimal control: the exact inverse, and where a limit holds, the optimum; it plans ahead."""

from __future__ import annotations

import functools
import math
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as TooLate
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pzt_ros.controllers.bounds import Bounds
from pzt_ros.controllers.controller import Controller, Feedback, model_offset, tracking_error
from pzt_ros.controllers.inverse import inverse_voltage
from pzt_ros.controllers.ladder import HOLD, INVERSE, NO_PLAN, PLAN, RAMP, SHIFTED, Plan, held_or_lowered
from pzt_ros.controllers.pi import proportional_integral, sample_period
from pzt_ros.errors import BenchError
from pzt_ros.optimal.block import Limits, Start, miss, optimal_block, rehearse
from pzt_ros.physics.chain import Chain, ChainState
from pzt_ros.physics.one_equation import OneEquation
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True)
class Planning:
    """Memory from tick to tick.

    Attributes:
        integral: of the tracking error [m].
        cut: what limits took of the last voltage of the inverse [V].
        plan: the last one that came in time.
        solving: the one that is being solved; None where none is.
        since: end of the last block with an answer better than to hold the voltage [s].
        rung: of the ladder on which the last answer stands.
    """

    integral: float
    cut: float = 0.0
    plan: Plan = NO_PLAN
    solving: Future[Plan | None] | None = field(default=None, compare=False, repr=False)
    since: float = math.inf
    rung: str = INVERSE


@dataclass(frozen=True)
class Block:
    """What a block begins with, and what is asked of it.

    Attributes:
        state: of the model.
        before, last: time [s] and voltage [V] before the block.
        time, target: of the samples, and displacement wanted there [s, m].
        bounds: of window and slew.
    """

    state: ChainState
    before: float
    last: float
    time: Array
    target: Array
    bounds: Bounds


@dataclass(frozen=True, kw_only=True)
class RecedingHorizon(Controller):
    """Optimal control over the blocks to come, with window, slew rate and current as limits.

    Without an active limit the optimum is the exact inverse. With one, each tick is answered by real-time iterations
    (Gauss-Newton steps with the limits in place, which are the tangential predictor of Diehl et al. 2005) from the plan
    that was solved in the background meanwhile; that plan looks `horizon` blocks ahead, the reference taken on as it
    last went. The answer counts only if the ceramic's own model misses the reference less with it than with the inverse
    held in its limits. A ceramic that is not parametrized, or a link between amplifier and ceramic, leaves it at that
    inverse. The integral of the tracking error moves the reference, as in `inverse_pi`.

    Without a plan (late, infeasible, no number): the plan before it, as far as it reaches; then the inverse within its
    limits; then, for a target that is no number, the last voltage, and after `hold_time` a ramp to 0 V. In lock-step
    nothing is late: `patience` 0 waits for the background, and a run repeats to the bit.
    """

    kind: ClassVar[str] = "receding_horizon"
    takes_over_smoothly: ClassVar[bool] = True

    integral_gain: float = parameter(30.0, "1/s", "share of the error per second", symbol="Ki", bounds=(0.0, 1e5))
    integral_limit: float = parameter(5e-6, "m", "the correction stays within plus and minus this", bounds=(0.0, 1e-3))
    current: float = parameter(0.2, "A", "largest mean current of a sample", bounds=(1e-6, 10.0))
    iterations: float = parameter(5.0, "1", "real-time iterations at most", bounds=(1.0, 100.0))
    horizon: float = parameter(3.0, "1", "blocks that a plan looks ahead", bounds=(1.0, 100.0))
    patience: float = parameter(
        0.0, "s", "to wait in a tick for the plan of the background; 0: as long as it takes", bounds=(0.0, 10.0)
    )
    hold_time: float = parameter(0.1, "s", "to hold the voltage where there is no answer", bounds=(0.0, 1e3))
    ramp_rate: float = parameter(100.0, "V/s", "down to 0 V after that", bounds=(0.1, 1e6))

    def init(self, model: Chain, feedback: Feedback) -> Planning:
        """The correction with which the inverse begins at the voltage found."""
        rehearse()
        return Planning(model_offset(model, feedback))

    def step(
        self, model: Chain, state: Planning, time: Array, reference: Array, feedback: Feedback
    ) -> tuple[Planning, Array]:
        """Drive voltage [V]."""
        step = self.integral_gain * sample_period(time, feedback.time[-1])
        integral, correction = proportional_integral(
            tracking_error(feedback), state.integral, 0.0, step, self.integral_limit, state.cut + feedback.cut
        )
        target, before = reference + correction, float(feedback.time[-1])
        block = Block(feedback.model, before, float(feedback.voltage[-1]), time, target, feedback.bounds)
        wanted = inverse_voltage(model, time, target, feedback)
        solved = self._collect(state.solving)
        rung, voltage = self._answer(model, block, wanted, solved or state.plan)
        since = min(state.since, before) if rung == HOLD else float(time[-1])
        if rung == HOLD:
            voltage = held_or_lowered(block.last, time, before, since + self.hold_time, self.ramp_rate)
            rung = HOLD if voltage[-1] == block.last else RAMP
        cut = float(wanted[-1] - voltage[-1])
        solving = None
        if rung in (PLAN, SHIFTED, INVERSE) and np.all(np.isfinite(target)):
            solving = _worker().submit(self._look_ahead, model, block, voltage)
        cut = cut if np.isfinite(cut) else 0.0
        return Planning(integral, cut, solved or state.plan, solving, since, rung), voltage

    def health(self, state: Planning) -> dict[str, str]:
        """On what rung of the ladder the last answer stands."""
        return {"answer": state.rung}

    def _collect(self, solving: Future[Plan | None] | None) -> Plan | None:
        """The plan of the background, if it is there in time and is one."""
        if solving is None:
            return None
        try:
            plan = solving.result(self.patience if self.patience > 0.0 else None)
        except (TooLate, BenchError):
            return None
        return plan if plan is not None and bool(np.all(np.isfinite(plan.voltage))) else None

    def _answer(self, model: Chain, block: Block, wanted: Array, plan: Plan) -> tuple[str, Array]:
        """The highest rung that there is, and its voltage over the block [V]; HOLD still has to be worked out."""
        planned = plan.over(block.time)
        if not (np.all(np.isfinite(block.target)) and np.isfinite(block.last)):
            if planned is None or not np.isfinite(block.last):
                return HOLD, wanted
            return SHIFTED, block.bounds.keep(planned, block.last, block.time, block.before)
        held = block.bounds.keep(wanted, block.last, block.time, block.before)
        ceramic = model.links[0] if model.links else None
        if not isinstance(ceramic, OneEquation):
            return INVERSE, held
        task = _Task(ceramic, model, block, self.current)
        if task.is_free(wanted, held):
            return PLAN, held
        guess = held if planned is None else block.bounds.keep(planned, block.last, block.time, block.before)
        optimum = task.optimum(guess, int(self.iterations))
        if optimum is not None and not task.costs_more(optimum, held):
            return PLAN, optimum
        if optimum is None and planned is not None and not task.costs_more(guess, held):
            return SHIFTED, guess
        return INVERSE, held

    def _look_ahead(self, model: Chain, block: Block, voltage: Array) -> Plan | None:
        """The plan for the blocks after this one, which goes through `voltage`; for the background."""
        state, _ = model.step(block.state, Signals(block.time, voltage))
        before, count = float(block.time[-1]), int(self.horizon) * block.time.size
        further = np.arange(1.0, count + 1.0)
        time = before + sample_period(block.time, block.before) * further
        way = float(block.target[-1] - block.target[-2]) if block.time.size > 1 else 0.0
        target = float(block.target[-1]) + way * further
        _, inverse = model.invert(state, Signals(time, displacement=target))
        ahead = Block(state, before, float(voltage[-1]), time, target, block.bounds)
        rung, planned = self._answer(model, ahead, inverse.voltage, NO_PLAN)
        return Plan(time, planned) if rung == PLAN else None


class _Task:
    """The optimal control problem of one block."""

    def __init__(self, ceramic: OneEquation, model: Chain, block: Block, current: float) -> None:
        behind = Chain(model.name, model.links[1:])
        _, signals = behind.invert(block.state[1:], Signals(block.time, displacement=block.target))
        thickness, bounds = ceramic.layer_thickness, block.bounds
        self.ceramic, self.block, self.current = ceramic, block, current
        self.polarization = signals.polarization
        self.start = Start(block.state[0], block.before, block.last / thickness)
        self.limits = Limits(
            bounds.voltage_min / thickness, bounds.voltage_max / thickness, bounds.slew_rate / thickness, current
        )

    def is_free(self, wanted: Array, held: Array) -> bool:
        """Whether the inverse keeps all limits by itself, or there is nothing to plan with."""
        if not np.all(np.isfinite(self.polarization)):
            return True
        return bool(np.array_equal(wanted, held)) and self._peak(held) <= self.current

    def optimum(self, guess: Array, iterations: int) -> Array | None:
        """The best voltage from a guess [V], as far as the iterations come; None where there is none."""
        thickness, block = self.ceramic.layer_thickness, self.block
        found = optimal_block(
            self.ceramic, self.start, block.time, self.polarization, guess / thickness, self.limits, iterations
        )
        if found is None or not np.all(np.isfinite(found)):
            return None
        return block.bounds.keep(found * thickness, block.last, block.time, block.before)

    def costs_more(self, voltage: Array, held: Array) -> bool:
        """Whether a plan is worse than the inverse held in window and slew; one that keeps the current is not."""
        if self._peak(held) > self.current:
            return False
        return not self._miss(voltage) <= self._miss(held)

    def _miss(self, voltage: Array) -> float:
        fields = voltage / self.ceramic.layer_thickness
        return miss(self.ceramic, self.start, self.block.time, self.polarization, fields)

    def _peak(self, voltage: Array) -> float:
        """The largest mean current of a sample under a voltage [A]."""
        times = np.concatenate([[self.block.before], self.block.time])
        _, out = self.ceramic.step(self.block.state[0], Signals(times, np.concatenate([[self.block.last], voltage])))
        rates = np.diff(out.polarization) / np.diff(times)
        return float(self.ceramic.electrode_area * np.max(np.abs(rates)))


@functools.cache
def _worker() -> ThreadPoolExecutor:
    """The thread that solves while the others answer; the compiled loops leave them the interpreter."""
    return ThreadPoolExecutor(max_workers=1, thread_name_prefix="plan ahead")
