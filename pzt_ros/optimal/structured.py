"""The structured solver as an object: a plan and what the compiled Riccati iterations need beside it."""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.optimal import riccati
from pzt_ros.optimal.interval import COLUMNS, FIELD, X
from pzt_ros.optimal.law import Material
from pzt_ros.optimal.memory import has_history, initial_fraction, law_without_history, material_of
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.solution import Solution
from pzt_ros.physics.signals import Array

_TOLERANCE = 1.0
"""No field would move by more [V/m]."""

_MOST_ITERATIONS = 200


class Planner:
    """Two plans and a task; `plan` is the present one [shape (N + 1, COLUMNS), `interval.py` says what is in it].

    Args:
        material: of the ceramic.
        numbers: of the problem.
        task: barrier law and set-point at the Radau points of every interval [shape (N, 11)].
        start: x+ at the beginning.
    """

    def __init__(self, material: Material, numbers: riccati.Numbers, task: Array, start: float) -> None:
        self.material, self.numbers, self.task, self.start = material, numbers, task, start
        self.plan: Array = np.zeros((task.shape[0] + 1, COLUMNS))
        self._other = np.zeros_like(self.plan)
        self._cost = math.nan

    def begin(self, field: float = 0.0) -> float:
        """Forget the plan: a constant field [V/m] as far as the limits let it; returns its cost."""
        self._cost = riccati.begin(
            self.plan, self._other, self.task, self.material, self.numbers, self.start, float(field)
        )
        return self._cost

    def solve(self, most: int = _MOST_ITERATIONS) -> tuple[float, int, bool]:
        """From the present plan to the optimum: the cost [C^2 s/m^4], the iterations, whether it has converged."""
        found = riccati.solve(
            self.plan, self._other, self.task, self.material, self.numbers, self.start, self._cost, _TOLERANCE,
            most,
        )  # fmt: skip
        self._cost = math.nan
        return found

    def iterate(self, phase_fraction: float) -> float:
        """One real-time iteration from another x+; returns the cost, infinite where it failed and the plan stays."""
        if not 0.0 <= phase_fraction <= 1.0:
            return math.inf
        cost = riccati.iterate(self.plan, self._other, self.task, self.material, self.numbers, phase_fraction)
        if not math.isfinite(cost):
            return math.inf
        self.plan, self._other = self._other, self.plan
        self._cost = math.nan
        return cost

    def ask(self, set_point: Array) -> None:
        """Another set-point [C/m^2, shape (N, 3)] at the Radau points."""
        self.task[:, -3:] = set_point
        self._cost = math.nan

    @property
    def field(self) -> Array:
        """Of the present plan [V/m, shape (N + 1,)]."""
        return self.plan[:, FIELD]

    @property
    def phase_fraction(self) -> Array:
        """Of the present plan [shape (N + 1,)]."""
        return self.plan[:, X]


class Structured(Planner):
    """A problem made ready for the structured solver.

    Raises:
        BenchError: the ceramic has history: the laws of later branches would depend on the plan.
    """

    def __init__(self, problem: Problem) -> None:
        if has_history(problem):
            raise BenchError(
                f"{problem.name}: the structured solver needs a ceramic without history; use collocation or simulation"
            )
        self.problem = problem
        numbers = riccati.Numbers(
            h=problem.step,
            lowest=float(problem.field_min),
            highest=float(problem.field_max),
            step=float(problem.field_step),
            charge=float(problem.charge_step),
            initial_field=float(problem.initial_field),
            rate_weight=float(problem.rate_weight),
            end_weight=float(problem.end_weight),
        )
        laws = np.tile(law_without_history(problem.ceramic), (problem.steps, 1))
        task = np.hstack([laws, problem.set_point_at(problem.stage_times)])
        super().__init__(material_of(problem), numbers, task, initial_fraction(problem))


def solve_structured(problem: Problem, field: float) -> Solution:
    """Solve a problem by Riccati iterations from a constant field [V/m]; what is compiled is compiled before."""
    short = dataclasses.replace(problem, intervals=2.0, segments=None)
    rehearsal = Structured(short)
    rehearsal.begin(field)
    rehearsal.solve()
    structured = Structured(problem)
    began = time.perf_counter()
    first = structured.begin(field)
    cost, iterations, converged = structured.solve()
    taken = time.perf_counter() - began
    status = "converged" if converged else "line search failed" if math.isfinite(first) else "no first trajectory"
    return Solution(
        problem, structured.field.copy(), structured.phase_fraction.copy(), cost, "riccati", iterations, converged,
        status, taken,
    )  # fmt: skip
