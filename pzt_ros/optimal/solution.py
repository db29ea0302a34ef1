"""What a solver finds, and what the ceramic itself does under that field."""

from __future__ import annotations

import dataclasses
import functools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from pzt_ros.optimal.memory import initial_fraction
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.radau import NODES, WEIGHTS
from pzt_ros.physics import parametrized_single_branch as single
from pzt_ros.physics.link import State
from pzt_ros.physics.one_equation import OneEquation
from pzt_ros.physics.signals import Array, Rest, Signals

_ACCURACY = 1e-10


@dataclass(frozen=True)
class Simulated:
    """The ceramic's own way under a field: times [s], field [V/m], x+ [-], P [C/m^2], all of shape (1 + 3 N,).

    Attributes:
        cost: of (4.1) and the weights [C^2 s/m^4].
        spent: how much of the squared miss has been gathered by each time [C^2 s/m^4, shape (1 + 3 N,)].
    """

    time: Array
    field: Array
    phase_fraction: Array
    polarization: Array
    cost: float
    spent: Array


@dataclass(frozen=True)
class Solution:
    """An optimal field and how it was found.

    Attributes:
        problem: that was solved.
        field: at the points of the grid, linear between [V/m, shape (N + 1,)].
        phase_fraction: x+ there, as the solver has it [-, shape (N + 1,)].
        cost: of (4.1), with the solver's own quadrature, and the weights [C^2 s/m^4].
        solver, iterations, converged, status: how it went.
        solve_time: without the time to set the solver up [s].
    """

    problem: Problem
    field: Array
    phase_fraction: Array
    cost: float
    solver: str
    iterations: int
    converged: bool
    status: str
    solve_time: float

    @property
    def polarization(self) -> Array:
        """P at the points of the grid [C/m^2, shape (N + 1,)] (3.20)."""
        ceramic = self.problem.ceramic
        return self.field / ceramic.reciprocal_permittivity + (2.0 * self.phase_fraction - 1.0) * (
            ceramic.domain_polarization
        )

    @functools.cached_property
    def simulated(self) -> Simulated:
        """What the ceramic itself does under the field: the check on every solver."""
        return simulate(self.problem, self.field)

    @property
    def model_error(self) -> float:
        """Largest difference in P between the solver's trajectory and the ceramic's own [C/m^2]."""
        return float(np.max(np.abs(self.polarization - self.simulated.polarization[::3])))

    def as_data(self) -> dict[str, Any]:
        """For `--json`; the names are fixed (contract)."""
        peak = int(np.argmax(np.abs(self.field)))
        return {
            "problem": self.problem.name,
            "peak_field_V_per_m": float(self.field[peak]),
            "peak_time_s": float(self.problem.grid[peak]),
            "end_field_V_per_m": float(self.field[-1]),
            "end_phase_fraction": float(self.phase_fraction[-1]),
            "cost": self.cost,
            "simulated_cost": self.simulated.cost,
            "model_error_C_per_m2": self.model_error,
            "solver": self.solver,
            "iterations": self.iterations,
            "converged": self.converged,
            "status": self.status,
            "solve_time_s": self.solve_time,
        }


def precise(problem: Problem) -> OneEquation:
    """The ceramic, integrated so that its errors do not count."""
    return dataclasses.replace(problem.ceramic, accuracy=_ACCURACY)


def initial_state(problem: Problem, ceramic: OneEquation) -> State:
    """The ceramic's state at the beginning of the horizon."""
    if math.isnan(problem.initial_phase_fraction):
        return ceramic.init(Rest())
    return single.fresh_state(ceramic.material, initial_fraction(problem))


def radau_times(problem: Problem) -> Array:
    """Time 0 and all Radau points [s, shape (1 + 3 N,)]; every third one is a point of the grid."""
    return np.concatenate([[0.0], problem.stage_times.ravel()])


def radau_fields(field: Array) -> Array:
    """The field there [V/m, shape (1 + 3 N,)], from its values on the grid [shape (N + 1,)]."""
    between = field[:-1, None] + NODES * np.diff(field)[:, None]
    return np.concatenate([field[:1], between.ravel()])


def simulate(problem: Problem, field: Array) -> Simulated:
    """Drive the ceramic with a field that is linear between the points of the grid [V/m, shape (N + 1,)]."""
    ceramic = precise(problem)
    time, fields = radau_times(problem), radau_fields(field)
    _, out = ceramic.step(initial_state(problem, ceramic), Signals(time, fields * ceramic.layer_thickness))
    miss = out.polarization - problem.set_point_at(time)
    spent = np.concatenate([[0.0], np.cumsum(np.tile(problem.step * WEIGHTS, problem.steps) * miss[1:] ** 2)])
    cost = spent[-1] + beside(problem, field) + problem.end_weight * miss[-1] ** 2
    return Simulated(time, fields, out.phase_fraction, out.polarization, float(cost), spent)


def beside(problem: Problem, field: Array) -> float:
    """The weighted integral of the squared field rate [C^2 s/m^4]."""
    return float(problem.rate_weight / problem.step * np.sum(np.diff(field) ** 2))
