"""The problem as a nonlinear programme in CasADi's expressions: direct collocation, and multiple shooting beside it.

Collocation: x+ at the three Radau points of every interval is unknown, the integral is Radau's sum; the same programme
that `riccati.py` solves. Multiple shooting: x+ at the grid's points is unknown, each interval is two steps of the
classical Runge-Kutta method, which carries the integral along; it shares nothing with the other but the rates.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.optimal.expressions import EXPRESSIONS, law_at, polarization, switching
from pzt_ros.optimal.inverse import inverse_field
from pzt_ros.optimal.memory import Memory, Run, has_history, initial_fraction, material_of
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.radau import MATRIX, NODES, STAGES, WEIGHTS
from pzt_ros.optimal.solution import simulate
from pzt_ros.physics.parametrized import Parametrized
from pzt_ros.physics.signals import Array, Rest

FIELD_SCALE = 1e6
"""Fields count in MV/m, so that all unknowns are about 1."""

_SUBSTEPS = 2
_MARGIN = 1e-9


@dataclass(frozen=True)
class Programme:
    """min f(z, p) with g_low <= g(z, p) <= g_high and z_low <= z <= z_high.

    Attributes:
        problem: that it came from.
        z: unknowns: the N + 1 fields [MV/m], then every x+.
        p: parameters: x+ at the beginning, the field there [MV/m] (of use only if that is given), the set-point
            [C/m^2] at `set_point_times`.
        cost: f, in units of `cost_scale`.
        constraints: g: the equations of the model first.
        z_low, z_high, g_low, g_high: bounds, infinite where there is none.
        parameters: the values of p.
        set_point_times: [s].
        cost_scale: [C^2 s/m^4].
        nodes: which unknowns are x+ at the ends of the intervals [shape (N,)].
    """

    problem: Problem
    z: Any
    p: Any
    cost: Any
    constraints: Any
    z_low: Array
    z_high: Array
    g_low: Array
    g_high: Array
    parameters: Array
    set_point_times: Array
    cost_scale: float
    nodes: Any

    def start(self, field: float) -> Array:
        """Unknowns of a first guess: a constant field [V/m], and x+ as in the beginning."""
        fields = self.problem.steps + 1
        guess = np.full(self.z_low.size, self.parameters[0])
        guess[:fields] = field / FIELD_SCALE
        return np.clip(guess, self.z_low, self.z_high)


class _Builder:
    """Gathers constraints and cost while the intervals are gone through."""

    def __init__(self, problem: Problem, inner: int, set_point_times: Array) -> None:
        self.problem, self.m = problem, material_of(problem)
        n = problem.steps
        self.times = set_point_times
        self.e = ca.SX.sym("E", n + 1)
        self.inner = ca.SX.sym("x", n, inner)
        self.x0, self.e0 = ca.SX.sym("x0"), ca.SX.sym("e0")
        self.set_point = ca.SX.sym("P", *set_point_times.shape)
        self.scale = problem.step * max(1e-12, float(np.max(np.abs(problem.set_point))) ** 2)
        self.cost: Any = 0.0
        self.g: list[Any] = []
        self.low: list[float] = []
        self.high: list[float] = []

    def node(self, k: int) -> Any:
        """x+ at a point of the grid."""
        return self.x0 if k == 0 else self.inner[k - 1, -1]

    @functools.cached_property
    def runs(self) -> list[Run]:
        """What the intervals follow; which loops are closed is read off the inverse's way."""
        ceramic, expected = self.problem.ceramic, lambda k: math.nan
        if has_history(self.problem):
            fractions = simulate(self.problem, inverse_field(self.problem)).phase_fraction[::STAGES]
            expected = lambda k: float(fractions[k])
        return Memory(ceramic, ceramic.init(Rest()), EXPRESSIONS).runs(self.problem, self.node, expected)

    def subject_to(self, expression: Any, low: float = 0.0, high: float = 0.0) -> None:
        self.g.append(expression)
        self.low.append(low)
        self.high.append(high)

    def add_limits(self) -> None:
        """Of slew, current and the initial field; the weights beside the squared miss."""
        problem, e, m = self.problem, self.e, self.m
        n, h = problem.steps, problem.step
        if not math.isnan(problem.initial_field):
            self.subject_to(e[0] - self.e0)
        if math.isfinite(problem.slew_rate):
            most = problem.field_step / FIELD_SCALE
            for k in range(n):
                self.subject_to(e[k + 1] - e[k], -most, most)
        if math.isfinite(problem.current):
            p = [polarization(m, self.node(k), FIELD_SCALE * e[k]) for k in range(n + 1)]
            for k in range(n):
                self.subject_to((p[k + 1] - p[k]) / problem.charge_step, -1.0, 1.0)
        if problem.rate_weight > 0.0:
            rates = FIELD_SCALE * (e[1:] - e[:-1]) / h
            self.cost += problem.rate_weight * h * ca.sumsqr(rates) / self.scale
        if problem.end_weight > 0.0:
            miss = polarization(m, self.node(n), FIELD_SCALE * e[n]) - self.set_point[n - 1, -1]
            self.cost += problem.end_weight * miss**2 / self.scale

    def programme(self) -> Programme:
        problem, n = self.problem, self.problem.steps
        inner = self.inner.shape[1]
        states = n * inner
        first = 0.0 if math.isnan(problem.initial_field) else problem.initial_field / FIELD_SCALE
        values = problem.set_point_at(self.times).ravel()
        return Programme(
            problem=problem,
            z=ca.vertcat(self.e, ca.vec(self.inner.T)),
            p=ca.vertcat(self.x0, self.e0, ca.vec(self.set_point.T)),
            cost=self.cost,
            constraints=ca.vertcat(*self.g),
            z_low=np.concatenate([np.full(n + 1, problem.field_min / FIELD_SCALE), np.full(states, _MARGIN)]),
            z_high=np.concatenate([np.full(n + 1, problem.field_max / FIELD_SCALE), np.full(states, 1.0 - _MARGIN)]),
            g_low=np.array(self.low),
            g_high=np.array(self.high),
            parameters=np.concatenate([[initial_fraction(problem), first], values]),
            set_point_times=self.times,
            cost_scale=self.scale,
            nodes=n + 1 + inner * np.arange(1, n + 1) - 1,
        )


def collocation(problem: Problem) -> Programme:
    """Direct collocation with the 3-stage Radau IIA method.

    Raises:
        BenchError: the ceramic has history and the problem no segments.
    """
    b = _Builder(problem, STAGES, problem.stage_times)
    f, h = switching(b.m), problem.step
    for k in range(problem.steps):
        run = b.runs[k]
        fields = [FIELD_SCALE * (b.e[k] + c * (b.e[k + 1] - b.e[k])) for c in NODES]
        rates = [f(b.inner[k, i], fields[i], law_at(run, b.inner[k, i])) for i in range(STAGES)]
        for i in range(STAGES):
            b.subject_to(b.inner[k, i] - b.node(k) - h * sum(MATRIX[i, j] * rates[j] for j in range(STAGES)))
            miss = polarization(b.m, b.inner[k, i], fields[i]) - b.set_point[k, i]
            b.cost += h * WEIGHTS[i] * miss**2 / b.scale
    b.add_limits()
    return b.programme()


def multiple_shooting(problem: Problem) -> Programme:
    """Multiple shooting; the set-point enters at the ends and middles of the steps.

    Raises:
        BenchError: as `collocation`; or the ceramic is so stiff behind a reversal that explicit steps do not do.
    """
    if isinstance(problem.ceramic, Parametrized):
        raise BenchError(
            f"{problem.name}: the explicit steps of multiple shooting are unstable just behind a reversal of"
            f" '{problem.ceramic.kind}'; use collocation or simulation"
        )
    points = 2 * _SUBSTEPS
    times = (np.arange(problem.steps)[:, None] + np.arange(1, points + 1) / points) * problem.step
    b = _Builder(problem, 1, times)
    f, h = switching(b.m), problem.step / _SUBSTEPS
    first = float(problem.set_point_at(np.zeros(1))[0])
    for k in range(problem.steps):
        run, x = b.runs[k], b.node(k)
        before = first if k == 0 else b.set_point[k - 1, -1]
        for s in range(_SUBSTEPS):
            begin, middle, end = (
                FIELD_SCALE * (b.e[k] + (s + share) / _SUBSTEPS * (b.e[k + 1] - b.e[k])) for share in (0.0, 0.5, 1.0)
            )
            asked = (before, b.set_point[k, 2 * s], b.set_point[k, 2 * s + 1])
            k1 = f(x, begin, law_at(run, x))
            x2 = x + 0.5 * h * k1
            k2 = f(x2, middle, law_at(run, x2))
            x3 = x + 0.5 * h * k2
            k3 = f(x3, middle, law_at(run, x3))
            x4 = x + h * k3
            k4 = f(x4, end, law_at(run, x4))
            after = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            misses = [
                polarization(b.m, value, field) - wanted
                for value, field, wanted in zip(
                    (x, x2, x3, x4), (begin, middle, middle, end), (asked[0], asked[1], asked[1], asked[2]), strict=True
                )
            ]
            squares = [miss**2 for miss in misses]
            b.cost += h / 6.0 * (squares[0] + 2.0 * squares[1] + 2.0 * squares[2] + squares[3]) / b.scale
            x, before = after, asked[2]
        b.subject_to(b.node(k + 1) - x)
    b.add_limits()
    return b.programme()
