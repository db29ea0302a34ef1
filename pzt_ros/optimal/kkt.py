"""The optimality conditions of a programme with its active set held: solutions to rounding, and their derivatives.

A limit that is active is an equation; what is left is a square system in the unknowns and the multipliers. Newton's
method solves it, and its matrix gives the derivatives of the solution by the parameters (Fiacco 1983).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from pzt_ros.errors import RunFailedError
from pzt_ros.optimal.ipopt import Point
from pzt_ros.optimal.transcription import Programme
from pzt_ros.physics.signals import Array

_ACTIVE = 1e-7
"""A multiplier counts from this share of the largest one on."""

_STEPS = 8

Numbers = NDArray[np.int64]
_SMALL = 1e-11


@dataclass(frozen=True)
class ActiveSet:
    """Which limits hold: of the unknowns and of the constraints, numbers and sides (-1 lower, 1 upper, 0 equation)."""

    bounds: Numbers
    bound_sides: Numbers
    constraints: Numbers
    constraint_sides: Numbers


@dataclass(frozen=True)
class Stationary:
    """A point that meets the conditions: unknowns z, multipliers of the active bounds and constraints, g there."""

    z: Array
    of_bounds: Array
    of_constraints: Array
    values: Array
    parameters: Array


class Conditions:
    """The conditions of a programme, with everything that Newton's method needs of them."""

    def __init__(self, programme: Programme) -> None:
        self.programme = programme
        z, p, g = programme.z, programme.p, programme.constraints
        multipliers = ca.SX.sym("lam", g.shape[0])
        lagrangian = programme.cost + ca.dot(multipliers, g)
        gradient = ca.gradient(lagrangian, z)
        self._first = ca.Function("first", [z, p, multipliers], [gradient, g, ca.jacobian(g, z)])
        hessian, _ = ca.hessian(lagrangian, z)
        by_p = ca.jacobian(ca.vertcat(gradient, g), p)
        self._second = ca.Function("second", [z, p, multipliers], [hessian, by_p])

    def active_set(self, point: Point, parameters: Array) -> ActiveSet:
        """Of an interior-point solution: equations, and where a limit and its multiplier meet."""
        programme = self.programme
        equation = programme.g_low == programme.g_high
        bounds = _held(point.z, point.of_bounds, programme.z_low, programme.z_high)
        values = np.array(self._first(point.z, parameters, point.of_constraints)[1]).ravel()
        sides = np.where(equation, 0, _held(values, point.of_constraints, programme.g_low, programme.g_high))
        chosen = np.flatnonzero(equation | (sides != 0))
        at_bound = np.flatnonzero(bounds)
        return ActiveSet(at_bound, bounds[at_bound], chosen, sides[chosen])

    def solve(self, near: Stationary, active: ActiveSet, parameters: Array) -> Stationary:
        """Newton's method from a point nearby.

        Raises:
            RunFailedError: it does not converge, or the active limits contradict one another.
        """
        programme = self.programme
        z, of_bounds, of_constraints = near.z.copy(), near.of_bounds.copy(), near.of_constraints.copy()
        fixed = np.where(active.bound_sides > 0, programme.z_high[active.bounds], programme.z_low[active.bounds])
        wanted = np.where(
            active.constraint_sides > 0, programme.g_high[active.constraints], programme.g_low[active.constraints]
        )
        for _ in range(_STEPS):
            gradient, values, rows = self._at(z, parameters, active, of_constraints)
            gradient[active.bounds] += of_bounds
            residual = np.concatenate([gradient, z[active.bounds] - fixed, values[active.constraints] - wanted])
            matrix, _ = self._matrix(z, parameters, active, of_constraints, rows)
            step = -_factor(matrix, self.programme.problem.name).solve(residual)
            n, m = z.size, active.bounds.size
            z, of_bounds, of_constraints = z + step[:n], of_bounds + step[n : n + m], of_constraints + step[n + m :]
            if np.max(np.abs(step[:n])) < _SMALL:
                break
        else:
            raise RunFailedError(
                f"{programme.problem.name}: Newton's method with the active limits held did not converge; the active"
                " set is not that of a solution nearby"
            )
        values = self._at(z, parameters, active, of_constraints)[1]
        return Stationary(z, of_bounds, of_constraints, values, parameters)

    def derivatives(self, at: Stationary, active: ActiveSet, directions: Array) -> tuple[Array, Array, Array]:
        """Derivatives of unknowns, multipliers (bounds, then constraints) and g by the parameters along `directions`.

        Args:
            at: a solution.
            active: its active set.
            directions: in the space of the parameters, shape (parameters, k).

        Returns:
            shapes (unknowns, k), (active limits, k), (constraints, k).
        """
        rows = self._at(at.z, at.parameters, active, at.of_constraints)[2]
        matrix, by_p = self._matrix(at.z, at.parameters, active, at.of_constraints, rows)
        n, m = at.z.size, active.bounds.size
        along = by_p @ directions
        right = np.vstack([along[:n], np.zeros((m, directions.shape[1])), along[n:][active.constraints]])
        found = -_factor(matrix, self.programme.problem.name).solve(right)
        return found[:n], found[n:], rows @ found[:n] + along[n:]

    def first(self, point: Point, active: ActiveSet, parameters: Array) -> Stationary:
        """The solution to rounding, from IPOPT's."""
        rough = Stationary(
            point.z, point.of_bounds[active.bounds], point.of_constraints[active.constraints], np.empty(0), parameters
        )  # fmt: skip
        return self.solve(rough, active, parameters)

    def _spread(self, active: ActiveSet, of_constraints: Array) -> Array:
        full = np.zeros(self.programme.g_low.size)
        full[active.constraints] = of_constraints
        return full

    def _at(self, z: Array, p: Array, active: ActiveSet, of_constraints: Array) -> tuple[Array, Array, Any]:
        gradient, values, rows = self._first(z, p, self._spread(active, of_constraints))
        return np.array(gradient).ravel(), np.array(values).ravel(), _sparse(rows)

    def _matrix(self, z: Array, p: Array, active: ActiveSet, of_constraints: Array, rows: Any) -> tuple[Any, Any]:
        hessian, by_p = (_sparse(part) for part in self._second(z, p, self._spread(active, of_constraints)))
        fixed: Any = sparse.eye(z.size, format="csr")[active.bounds]
        held = sparse.vstack([fixed, rows[active.constraints]])
        return sparse.bmat([[hessian, held.T], [held, None]], format="csc"), by_p


def _held(values: Array, multipliers: Array, low: Array, high: Array) -> Numbers:
    """Which limit holds a value: -1, 1, or 0 for none."""
    strong = np.abs(multipliers) > _ACTIVE * max(1e-300, float(np.max(np.abs(multipliers), initial=0.0)))
    near_low, near_high = values - low < 1e-5, high - values < 1e-5
    return np.where(strong & near_low & (multipliers < 0), -1, np.where(strong & near_high & (multipliers > 0), 1, 0))


def _sparse(matrix: Any) -> Any:
    return sparse.csc_matrix(ca.DM(matrix).sparse()).tocsr()


def _factor(matrix: Any, name: str) -> Any:
    try:
        return linalg.splu(matrix)
    except RuntimeError:
        raise RunFailedError(
            f"{name}: the active limits contradict one another or say the same twice; loosen one of them"
        ) from None
