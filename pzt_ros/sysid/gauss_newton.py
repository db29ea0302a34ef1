"""Bounded nonlinear least squares over several runs: Levenberg-Marquardt on the Gram matrix.

Made for tall problems: some hundred coordinates, 100,000 samples, Jacobians that may be float32. Each step solves the
damped quadratic model exactly within the bounds, so that non-negative weights come out as in NNLS.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.bounded_quadratic import bounded_minimum

_FIRST_DAMPING = 1e-4
_LEAST_DAMPING, _MOST_DAMPING = 1e-9, 1e10
_LIGHT = 1e-2  # damping up to which a small gain says that little is left to gain, and not that the step was short
_EASE, _GOOD = 1.0 / 3.0, 0.5  # damping falls so much where a step gains at least this share of what it promised
_LEAP_AFTER = 3  # refused steps
_LEAP_DAMPING, _LEAPS = 1e-8, (1.0, 0.3, 0.1)
"""Of a Gauss-Newton step, tried where short steps are refused: a model that decides, as on what is a reversal, has
cliffs in its cost, and a search that comes to the edge of one finds no short step down."""
_STUCK = 1e-3  # share of the tolerance below which refused steps are no longer shortened
_ROWS = 8192  # of a Jacobian that become float64 at once


class Problem(Protocol):
    """What is to be solved: residuals and Jacobians run by run."""

    def residuals(self, vector: Array) -> list[Array]:
        """Residual of each run [each shape (n,)]; a BenchError or a value that is not finite refuses the vector."""
        ...

    def linearise(self, vector: Array) -> tuple[list[Array], list[Array]]:
        """The same, and d(residual)/d(vector) of each run [each shape (n, p), float32 or float64]."""
        ...


@dataclass(frozen=True)
class Solution:
    """Where the search ended.

    Attributes:
        vector: [shape (p,)].
        residuals: there, run by run.
        cost: sum of squares of the residuals and of the rows of the prior.
        steps: accepted.
        converged: False where it ended for another reason than the tolerance.
    """

    vector: Array
    residuals: list[Array]
    cost: float
    steps: int
    converged: bool


def solve(
    problem: Problem,
    start: Array,
    lower: Array,
    upper: Array,
    *,
    most_steps: int,
    tolerance: float,
    prior: tuple[Array, Array] | None = None,
    progress: Callable[[int, float], None] = lambda step, cost: None,
) -> Solution:
    """The vector within the bounds with the least cost that descent from `start` finds.

    Args:
        problem: see `Problem`; at `start` it has to be defined.
        start, lower, upper: [shape (p,)]; the start is brought within the bounds.
        most_steps: accepted steps.
        tolerance: ends when a step gains, or promises to gain, less than this share of the cost [-].
        prior: further residuals rows @ vector - targets [shapes (m, p), (m,)].
        progress: is told the number of the step and the cost.

    Raises:
        BenchError: as the problem raises it at the start; a residual there that is not finite.
    """
    rows, targets = prior if prior is not None else (np.zeros((0, start.size)), np.zeros(0))
    vector = np.clip(np.asarray(start, dtype=float), lower, upper)
    residuals, jacobians = problem.linearise(vector) if most_steps else (problem.residuals(vector), [])
    cost = _cost(residuals, rows, targets, vector)
    if not math.isfinite(cost):
        raise BenchError("the model is not finite where the fit starts; check the parameters it starts from")
    damping, converged = _FIRST_DAMPING, False
    for count in range(most_steps):
        progress(count, cost)
        if count:
            residuals, jacobians = problem.linearise(vector)
        gram, gradient = normal_equations(residuals, jacobians)
        gram += rows.T @ rows
        gradient += rows.T @ (rows @ vector - targets)
        accepted, refused = False, 0
        while not accepted and damping <= _MOST_DAMPING:
            step = _damped_step(gram, gradient, damping, lower - vector, upper - vector)
            promised = -(2.0 * float(gradient @ step) + float(step @ gram @ step))
            converged = promised <= tolerance * cost * (_STUCK if refused or damping > _LIGHT else 1.0)
            if converged:
                break
            trial = np.clip(vector + step, lower, upper)
            gained = cost - cost_at(problem, trial, rows, targets)
            accepted = gained > 0.0
            if not accepted and refused == _LEAP_AFTER:
                bounds = (lower - vector, upper - vector)
                leaps = [share * _damped_step(gram, gradient, _LEAP_DAMPING, *bounds) for share in _LEAPS]
                costs = [cost_at(problem, np.clip(vector + leap, lower, upper), rows, targets) for leap in leaps]
                trial = np.clip(vector + leaps[int(np.argmin(costs))], lower, upper)
                gained = cost - min(costs)
                accepted = gained > 0.0
            if not accepted:
                refused += 1
                damping *= 2.0**refused
            elif gained > _GOOD * promised:
                damping = max(damping * _EASE, _LEAST_DAMPING)
        if not accepted:
            return Solution(vector, residuals, cost, count, converged)
        vector, cost = trial, cost - gained
        if not refused and damping <= _LIGHT and gained <= tolerance * (cost + gained):
            return Solution(vector, problem.residuals(vector), cost, count + 1, True)
    return Solution(vector, problem.residuals(vector), cost, most_steps, False)


def _cost(residuals: Sequence[Array], rows: Array, targets: Array, vector: Array) -> float:
    prior = rows @ vector - targets
    return sum(float(np.dot(r, r)) for r in residuals) + float(prior @ prior)


def cost_at(problem: Problem, vector: Array, rows: Array, targets: Array) -> float:
    """Sum of squares of the residuals and of the prior's rows at a vector; infinite where the problem refuses it.

    Args:
        problem: see `Problem`.
        vector: [shape (p,)].
        rows, targets: of the prior [shapes (m, p), (m,)].
    """
    try:
        cost = _cost(problem.residuals(vector), rows, targets, vector)
    except BenchError:
        return math.inf
    return cost if math.isfinite(cost) else math.inf


def normal_equations(residuals: Sequence[Array], jacobians: Sequence[Array]) -> tuple[Array, Array]:
    """J'J and J'r in float64, piece by piece: float32 sums over 100,000 samples would lose small differences."""
    size = jacobians[0].shape[1]
    gram, gradient = np.zeros((size, size)), np.zeros(size)
    for residual, jacobian in zip(residuals, jacobians, strict=True):
        used = np.flatnonzero(jacobian.any(axis=0))  # many coordinates belong to one run only
        part, place = np.zeros((used.size, used.size)), np.ix_(used, used)
        columns = used if used.size < size else slice(None)  # a copy of them costs as much as their products
        for low in range(0, residual.size, _ROWS):
            piece = jacobian[low : low + _ROWS, columns].astype(float, copy=False)
            part += piece.T @ piece
            gradient[used] += piece.T @ residual[low : low + _ROWS]
        gram[place] += part
    return gram, gradient


def _damped_step(gram: Array, gradient: Array, damping: float, low: Array, high: Array) -> Array:
    """The bounded step of least damped cost; columns are scaled to length 1 first, so units do not matter."""
    length = np.sqrt(np.diag(gram))
    length[length == 0.0] = 1.0
    scaled = gram / np.outer(length, length)
    scaled[np.diag_indices_from(scaled)] += damping
    return bounded_minimum(scaled, gradient / length, low * length, high * length) / length
