"""Real-time updates of an optimal field from a table of solutions over two parameters.

An expansion of the solution does not reach far: within 1 % of a parameter the fields at the beginning and at the
corners of the set-point cross the thermal width, over which the rates change by orders of magnitude, and the active set
may change. The structured solver needs a millisecond or less for a solution, so in a second or two the solution is
found anew on a fine grid over x+ at the beginning and the level of the set-point; between its nodes it is a bicubic
(cubic convolution: Keys, IEEE Trans. ASSP 29, 1981), and bilinear where the active set changes nearby and the solution
has a kink. Two parameters are what a grid can take; for more there are expansions (`sensitivity`) and real-time
iterations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pzt_ros.errors import RunFailedError
from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.sensitivity import Update
from pzt_ros.optimal.structured import Structured
from pzt_ros.physics.signals import Array

_AT_LIMIT = 1.0
"""[V/m] from a limit of the window, within which a field is held by it."""


@dataclass(frozen=True)
class Direction:
    """A parameter of the update, as what a unit of it adds to the problem's own.

    Attributes:
        name: of it.
        phase_fraction: x+ at the beginning [-].
        set_point: its corners [C/m^2].
        reach: the table goes from minus to plus this.
    """

    name: str
    phase_fraction: float
    set_point: tuple[float, ...]
    reach: float


Pair = tuple[Direction, Direction]


def start_and_level(problem: Problem, share: float = 0.01) -> Pair:
    """x+ at the beginning, and the set-point as a whole, each by up to a share of itself."""
    none = (0.0,) * len(problem.set_point)
    start = Structured(problem).start
    return (
        Direction("x0", 1.0, none, share * start),
        Direction("level", 0.0, tuple(float(p) for p in problem.set_point), share),
    )


class Tabulated:
    """The optimal field of a problem over two of its parameters.

    Args:
        problem: for the structured solver.
        directions: the parameters; `start_and_level` by default.
        places: of the grid on each side of the problem's own.

    Raises:
        RunFailedError: the solver did not converge somewhere.
        BenchError: as `Structured`.
    """

    def __init__(self, problem: Problem, directions: Pair | None = None, places: int = 48) -> None:
        self.directions = directions or start_and_level(problem)
        self._spacing = tuple(direction.reach / places for direction in self.directions)
        self._places = places
        solver = _Solver(problem, self.directions)
        self.field = solver.at((0.0, 0.0))
        self._fields = self._solved(solver)
        low, high = problem.field_min, problem.field_max
        held = (self._fields >= high - _AT_LIMIT).astype(np.int8) - (self._fields <= low + _AT_LIMIT)
        self._same: Any = np.all(held == held[places + 1, places + 1], axis=2)
        self._smooth = _alike(held)
        self._window = low, high
        self._out = np.empty_like(self.field)

    def update(self, first: float, second: float) -> Update:
        """The field for parameters that changed by so much; beyond the grid, as at its edge."""
        same = _look_up(
            first / self._spacing[0] + self._places, second / self._spacing[1] + self._places, self._fields,
            self._same, self._smooth, *self._window, self._out,
        )  # fmt: skip
        return Update(self._out, same)

    def _solved(self, solver: _Solver) -> Array:
        """Solutions on the grid, one place beyond the reach [shape (2 places + 3, 2 places + 3, N + 1)]."""
        beyond = np.arange(-self._places - 1, self._places + 2)
        fields = np.empty((beyond.size, beyond.size, self.field.size))
        for i, first in enumerate(beyond):
            ordered = range(beyond.size) if i % 2 == 0 else range(beyond.size - 1, -1, -1)
            for j in ordered:  # there and back, so that each begins at its neighbour's
                fields[i, j] = solver.at((first * self._spacing[0], beyond[j] * self._spacing[1]))
        return fields


def _alike(held: NDArray[np.int8]) -> Any:
    """For each cell inside whether the active set is one at all 16 places about it."""
    cells = held.shape[0] - 3
    alike = np.ones((cells, cells), dtype=np.bool_)
    for a in range(4):
        for b in range(4):
            alike &= np.all(held[a : a + cells, b : b + cells] == held[1:-2, 1:-2], axis=2)
    return alike


class _Solver:
    """The structured solver at places along the directions."""

    def __init__(self, problem: Problem, directions: Pair) -> None:
        self._problem, self._directions = problem, directions
        self._solver = Structured(problem)
        self._solver.begin(0.25 * float(np.clip(problem.field_max, -6e6, 6e6)))
        self._start = self._solver.start
        stages, corners = problem.stage_times, np.array(problem.set_point_times)
        self._hats = np.stack([np.interp(stages, corners, row) for row in np.eye(corners.size)])

    def at(self, coordinates: tuple[float, float]) -> Array:
        """The optimal field [V/m, shape (N + 1,)]."""
        moved = list(zip(coordinates, self._directions, strict=True))
        corners = np.array(self._problem.set_point) + sum(c * np.array(d.set_point) for c, d in moved)
        self._solver.start = self._start + sum(c * d.phase_fraction for c, d in moved)
        self._solver.ask(np.tensordot(corners, self._hats, 1))
        _, _, converged = self._solver.solve()
        if not converged:
            raise RunFailedError(f"{self._problem.name}: no solution where parameters change by {coordinates}")
        field: Array = self._solver.field.copy()
        return field


@njit(cache=True, error_model="numpy")
def _weights(t: float, smooth: bool) -> tuple[float, float, float, float]:
    """Of the four places about a cell, for a place in it [0, 1]; of two where the solution is not smooth."""
    if not smooth:
        return 0.0, 1.0 - t, t, 0.0
    before = ((-0.5 * t + 1.0) * t - 0.5) * t
    after = (0.5 * t - 0.5) * t * t
    return before, (1.5 * t - 2.5) * t * t + 1.0, ((-1.5 * t + 2.0) * t + 0.5) * t, after


@njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
def _look_up(
    first: float, second: float, fields: Array, same: Any, smooth: Any, low: float, high: float, out: Array
) -> bool:
    """Fill `out` with the field at a place of the grid; whether the active set is that of the middle all about it."""
    last = fields.shape[0] - 3.0
    inside = 0.0 <= first <= last and 0.0 <= second <= last
    first, second = min(max(first, 0.0), last), min(max(second, 0.0), last)
    i, j = min(int(first), int(last) - 1), min(int(second), int(last) - 1)
    w, v = _weights(first - i, smooth[i, j]), _weights(second - j, smooth[i, j])
    for row in range(out.size):
        out[row] = 0.0
    for a in range(4):
        for b in range(4):
            weight, field = w[a] * v[b], fields[i + a, j + b]
            for row in range(out.size):
                out[row] += weight * field[row]
    for row in range(out.size):
        out[row] = min(max(out[row], low), high)
    return inside and same[i + 1, j + 1] and same[i + 1, j + 2] and same[i + 2, j + 1] and same[i + 2, j + 2]
