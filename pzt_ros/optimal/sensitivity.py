"""Real-time updates of an optimal field from parametric sensitivities (Bueskens and Maurer 2000), to second order.

The first-order update is theirs. Its error grows with the square of the perturbation; the parameters here are few (x+
at the beginning, the corners of the set-point), so the second derivatives of the solution are few as well and the
update takes them in: features of the perturbation times one matrix. Along with the fields go the multipliers of the
limits that are active and the values of those that are not: where one leaves its range, the active set has changed and
the update says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from pzt_ros.optimal.ipopt import Ipopt, Point
from pzt_ros.optimal.kkt import Conditions, Numbers, Stationary
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.transcription import FIELD_SCALE, Programme, collocation
from pzt_ros.physics.signals import Array

_DIFFERENCE = 1e-3
"""Of a parameter over its size, for second derivatives by central differences of the first ones."""

_TOLERANCE = 1e-7
"""By which a watched value may leave its range: fields in MV/m, limits and multipliers in the programme's units."""

_CAUTION = 0.25
"""The active set counts as changed if it would for a change of the solution that is larger by this share."""


@dataclass(frozen=True)
class Update:
    """A field [V/m, shape (N + 1,)] inside its window; `same_active_set` False: solve anew when there is time."""

    field: Array
    same_active_set: bool


@njit(cache=True, fastmath=True, error_model="numpy")
def _update(
    change: Array, order: int, features: Array, gains: Array, at: Array, low: Array, high: Array, out: Array
) -> bool:
    """Fill `out` [shape (rows,)] with `at` + features of `change` times `gains`; whether all rows are in their ranges.

    Args:
        change: of the parameters, shape (k,).
        order: 1 or 2; the gains have k or k + k (k + 1)/2 rows.
        features: scratch, as long as the gains have rows.
        gains: shape (features, rows).
        at: rows at the solution that was differentiated.
        low, high: their ranges.
        out: is written.
    """
    k = change.size
    features[:k] = change
    if order == 2:
        n = k
        for i in range(k):
            for j in range(i, k):
                features[n] = change[i] * change[j] * (0.5 if i == j else 1.0)
                n += 1
    for row in range(out.size):
        out[row] = at[row]
    for i in range(gains.shape[0]):
        f = features[i]
        if f != 0.0:
            for row in range(out.size):
                out[row] += f * gains[i, row]
    inside = 0
    for row in range(out.size):
        farther = out[row] + _CAUTION * (out[row] - at[row])
        inside += (farther >= low[row]) & (farther <= high[row])
    return inside == out.size


@dataclass(frozen=True)
class Space:
    """The parameters of a problem that an update may change: x+ at the beginning, E(0) if given, set-point's corners.

    Attributes:
        names: `x0`, `E0` if the problem gives it, `P1`, `P2`, ...
        nominal: their values [-, V/m, C/m^2].
        sizes: what counts as all of them [same units].
        units: of the programme's parameters in theirs.
        directions: each as a direction among the programme's parameters, shape (programme's, k).
    """

    names: tuple[str, ...]
    nominal: Array
    sizes: Array
    units: Array
    directions: Array

    @staticmethod
    def of(programme: Programme) -> Space:
        """Of the problem behind a programme."""
        problem, total = programme.problem, programme.parameters.size
        corners, levels = np.array(problem.set_point_times), np.array(problem.set_point)
        names, units = ["x0"], [1.0]
        nominal = [programme.parameters[0]]
        columns = [_unit(total, 0)]
        if np.isfinite(problem.initial_field):
            names.append("E0")
            units.append(FIELD_SCALE)
            nominal.append(problem.initial_field)
            columns.append(_unit(total, 1))
        times = programme.set_point_times.ravel()
        for k in range(corners.size):
            names.append(f"P{k + 1}")
            units.append(1.0)
            nominal.append(levels[k])
            columns.append(np.concatenate([[0.0, 0.0], np.interp(times, corners, _unit(corners.size, k))]))
        size = max(1e-12, float(np.max(np.abs(levels))))
        sizes = [{"x": nominal[0], "E": FIELD_SCALE}.get(name[0], size) for name in names]
        return Space(tuple(names), np.array(nominal), np.array(sizes), np.array(units), np.array(columns).T)


class Sensitivity:
    """Updates of one solution for small changes of the initial state and of the set-point.

    Attributes:
        space: the parameters.
        nominal: their values at the solution that was differentiated [-, V/m, C/m^2].
        active: the active set that the updates hold.
        field: the solution they start from [V/m, shape (N + 1,)].
    """

    def __init__(self, conditions: Conditions, point: Point, parameters: Array, order: int = 2) -> None:
        programme = conditions.programme
        self.space = Space.of(programme)
        self._conditions, self._order = conditions, order
        self._fields = programme.problem.steps + 1
        self.active = conditions.active_set(point, parameters)
        solution = conditions.first(point, self.active, parameters)
        self.nominal = self.space.nominal.copy()
        self.nominal[0] = parameters[0]
        self.field = FIELD_SCALE * solution.z[: self._fields]
        self._limits, self._low, self._high = self._watched(programme)
        self._at = self._rows_of(solution)
        self._gains = self._differentiate(solution)
        self._features, self._out = np.zeros(self._gains.shape[0]), np.zeros(self._at.size)
        self._window = programme.z_low[: self._fields], programme.z_high[: self._fields]

    def update(self, parameters: Array) -> Update:
        """The field for other parameters, in the order of `space.names` [SI, shape (k,)]."""
        change = (parameters - self.nominal) / self.space.units
        same = _update(
            change, self._order, self._features, self._gains, self._at, self._low, self._high, self._out
        )  # fmt: skip
        field = self._out[: self._fields]
        if not same:
            field = np.clip(field, *self._window)
        return Update(FIELD_SCALE * field, bool(same))

    def _watched(self, programme: Programme) -> tuple[Numbers, Array, Array]:
        """Which constraints are limits, and the ranges of all rows: fields, limits, multipliers of the active ones."""
        limits = np.flatnonzero(programme.g_low < programme.g_high)
        sides = np.concatenate([self.active.bound_sides, self.active.constraint_sides])
        low = np.concatenate(
            [programme.z_low[: self._fields], programme.g_low[limits], np.where(sides > 0, 0.0, -np.inf)]
        )
        high = np.concatenate(
            [programme.z_high[: self._fields], programme.g_high[limits], np.where(sides < 0, 0.0, np.inf)]
        )
        return limits, low - _TOLERANCE, high + _TOLERANCE

    def _rows_of(self, at: Stationary) -> Array:
        return np.concatenate([at.z[: self._fields], at.values[self._limits], at.of_bounds, at.of_constraints])

    def _gains_at(self, at: Stationary) -> Array:
        """Derivatives of all rows by the parameters [shape (k, rows)]."""
        z, multipliers, values = self._conditions.derivatives(at, self.active, self.space.directions)
        return np.ascontiguousarray(np.vstack([z[: self._fields], values[self._limits], multipliers]).T)

    def _differentiate(self, solution: Stationary) -> Array:
        """Gains of the first order, and half a triangle of those of the second [shape (features, rows)]."""
        first = self._gains_at(solution)
        if self._order == 1:
            return first
        k = len(self.space.names)
        second = np.zeros((k, *first.shape))
        for i in range(k):
            nudge = _DIFFERENCE * self.space.sizes[i] / self.space.units[i]
            gains = []
            for sign in (-1.0, 1.0):
                parameters = solution.parameters + sign * nudge * self.space.directions[:, i]
                gains.append(self._gains_at(self._conditions.solve(solution, self.active, parameters)))
            second[i] = (gains[1] - gains[0]) / (2.0 * nudge)
        second = 0.5 * (second + second.transpose(1, 0, 2))
        triangle = [second[i, j] for i in range(k) for j in range(i, k)]
        return np.ascontiguousarray(np.vstack([first, *triangle]))


def sensitivity(problem: Problem, order: int = 2) -> Sensitivity:
    """Of one solution, at the problem's own parameters. Raises as `collocation`."""
    programme = collocation(problem)
    guess = programme.start(0.25 * float(np.clip(problem.field_max, -6e6, 6e6)))
    point = Ipopt(programme).solve(guess, programme.parameters)
    return Sensitivity(Conditions(programme), point, programme.parameters, order)


def _unit(size: int, place: int) -> Array:
    return np.eye(1, size, place).ravel()
