"""Gauss-Newton through the ceramic itself: any history, and as many reversals as the solution wants, wherever.

The compiled model is run with every field of the grid changed a little, from the point on where that matters; reversal
and closure of loops are the model's own affair. P is continuous over them, so the method goes on over a change of the
sequence; it needs no segments. The linear least-squares problem with its limits is a small quadratic programme.
"""

from __future__ import annotations

import math
import time
from typing import Any

import casadi as ca
import numpy as np

from pzt_ros.optimal.inverse import inverse_field
from pzt_ros.optimal.ipopt import QUIET
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.radau import NODES, STAGES, WEIGHTS
from pzt_ros.optimal.solution import Solution, beside, initial_state, precise, radau_fields, radau_times, simulate
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Signals

_ATTEMPTS = tuple((nudge, damping) for damping in (1e-9, 1e-3, 1e-1) for nudge in (1e3, -1e3, 1e4, -1e4))
"""How much a field is changed for its column [V/m], and the damping of the step.

At a reversal P has a kink over the field: the derivative to one side may lead nowhere and that to the other on. Where
none of these finds a better field, there is none nearby.
"""

_TOLERANCE = 10.0  # no field would move by more [V/m]
_MOST = 60
_NO_GAIN = 1e-6  # of the cost: a step so useless is none
_SHORTEST = 0.03  # share of a step
_PRICE = 20.0
_SCALE = 1e6


class ThroughModel:
    """A problem made ready: the ceramic, its states along the present field, and the quadratic programme."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.ceramic = problem, precise(problem)
        self.time = radau_times(problem)
        self.asked = problem.set_point_at(self.time)
        self.begin = initial_state(problem, self.ceramic)
        n = problem.steps + 1
        self.differences = np.diff(np.eye(n), axis=0)
        rows = (n - 1) * (math.isfinite(problem.slew_rate) + math.isfinite(problem.current))
        shape = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity.dense(rows, n)}
        self._qp = ca.conic("qp", "nlpsol", shape, {"nlpsol": "ipopt", "nlpsol_options": QUIET})

    def run(self, field: Array) -> tuple[list[State], Array]:
        """States at the points of the grid, and P [C/m^2, shape (1 + 3 N,)]."""
        fields = radau_fields(field)
        state, first = self._part(self.begin, slice(0, 1), fields)
        states, values = [state], [first]
        for k in range(self.problem.steps):
            state, p = self._part(state, slice(1 + STAGES * k, 1 + STAGES * (k + 1)), fields)
            states.append(state)
            values.append(p)
        return states, np.concatenate(values)

    def _part(self, state: State, part: slice, fields: Array) -> tuple[State, Array]:
        voltage = fields[part] * self.ceramic.layer_thickness
        after, out = self.ceramic.step(state, Signals(self.time[part], voltage))
        return after, out.polarization

    def slopes(self, field: Array, states: list[State], p: Array, nudge: float) -> Array:
        """dP/dE at the Radau points [C/m^2 per V/m, shape (1 + 3 N, N + 1)]."""
        found = np.zeros((p.size, field.size))
        for k in range(field.size):
            fields = radau_fields(field + nudge * (np.arange(field.size) == k))
            part = slice(0, None) if k == 0 else slice(1 + STAGES * (k - 1), None)
            state = self.begin if k == 0 else states[k - 1]
            found[part, k] = (self._part(state, part, fields)[1] - p[part]) / nudge
        return found

    def cost(self, p: Array, field: Array) -> float:
        """Of (4.1) and the weights [C^2 s/m^4]."""
        miss = p - self.asked
        squares = self.problem.step * np.tile(WEIGHTS, self.problem.steps) @ miss[1:] ** 2
        return float(squares + beside(self.problem, field) + self.problem.end_weight * miss[-1] ** 2)

    def merit(self, p: Array, field: Array) -> float:
        """The cost, and a price on charge beyond the limit by current: the one limit that a step may leave."""
        beyond = np.maximum(np.abs(np.diff(p[::STAGES])) - self.problem.charge_step, 0.0)
        price = _PRICE * self.problem.step * float(np.max(np.abs(self.asked)))
        return self.cost(p, field) + price * float(np.sum(beyond))

    def step(self, field: Array, p: Array, slopes: Array, damping: float) -> Array:
        """The best change of the field in the linear model [V/m, shape (N + 1,)], inside all limits."""
        problem, h = self.problem, self.problem.step
        weights = np.concatenate([[0.0], np.tile(h * WEIGHTS, problem.steps)])
        weights[-1] += problem.end_weight
        per_rate = problem.rate_weight / h
        d = self.differences
        hessian = slopes.T @ (weights[:, None] * slopes) + per_rate * d.T @ d
        gradient = slopes.T @ (weights * (p - self.asked)) + per_rate * d.T @ np.diff(field)
        scale = np.trace(hessian) / field.size
        hessian = (hessian / scale + damping * np.eye(field.size)) * _SCALE
        first = problem.initial_field - field[0] if not math.isnan(problem.initial_field) else math.nan
        low, high = problem.field_min - field, problem.field_max - field
        if not math.isnan(first):
            low[0] = high[0] = first
        rows, now, most = self._limits(field, p, slopes)
        found: dict[str, Any] = self._qp(
            h=hessian, g=gradient / scale, a=rows, lba=(-most - now) / _SCALE, uba=(most - now) / _SCALE,
            lbx=low / _SCALE, ubx=high / _SCALE,
        )  # fmt: skip
        return np.clip(np.array(found["x"]).ravel() * _SCALE, low, high)

    def _limits(self, field: Array, p: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """Slew and current, as far as limited: rows of the linear model, values now, and their limits [V/m]."""
        problem, nodes = self.problem, slice(None, None, STAGES)
        per_charge = float(self.ceramic.material.reciprocal_permittivity)  # so that all rows are of one size
        rows, now, most = [np.zeros((0, field.size))], [np.zeros(0)], [np.zeros(0)]
        if math.isfinite(problem.slew_rate):
            rows.append(self.differences)
            now.append(np.diff(field))
            most.append(np.full(field.size - 1, problem.field_step))
        if math.isfinite(problem.current):
            rows.append(np.diff(slopes[nodes], axis=0) * per_charge)
            now.append(np.diff(p[nodes]) * per_charge)
            most.append(np.full(field.size - 1, problem.charge_step * per_charge))
        return np.vstack(rows), np.concatenate(now), np.concatenate(most)


def solve_through_model(problem: Problem) -> Solution:
    """From the inverse's field to the optimum, by Gauss-Newton steps with a line search."""
    began = time.perf_counter()
    model, field = ThroughModel(problem), inverse_field(problem)
    states, p = model.run(field)
    merit, attempt, iterations, converged = model.merit(p, field), 0, 0, False
    while iterations < _MOST and not converged:
        iterations += 1
        nudge, damping = _ATTEMPTS[attempt]
        change = model.step(field, p, model.slopes(field, states, p, nudge), damping)
        if np.max(np.abs(change)) <= _TOLERANCE:
            converged = True
            break
        share, there = 1.0, math.inf
        while share > _SHORTEST and not there < merit:
            tried = field + share * change
            states_there, p_there = model.run(tried)
            there = model.merit(p_there, tried)
            share *= 0.4
        if there < (1.0 - _NO_GAIN) * merit:
            field, states, p, merit, attempt = tried, states_there, p_there, there, 0
        else:
            attempt += 1
            converged = attempt == len(_ATTEMPTS)
    taken = time.perf_counter() - began
    status = "converged" if converged else "most iterations reached"
    fraction = simulate(problem, field).phase_fraction[::STAGES]
    return Solution(
        problem, field, fraction, model.cost(p, field), "simulation", iterations, converged, status, taken
    )  # fmt: skip


assert NODES[-1] == 1.0, "every third sample is a point of the grid"
