"""The exact inverse as a plan: what optimal control is measured against, where it starts, and what it falls back to."""

from __future__ import annotations

import math

from pzt_ros.optimal.problem import Problem
from pzt_ros.optimal.solution import initial_state, precise
from pzt_ros.physics.signals import Array, Signals


def inverse_field(problem: Problem) -> Array:
    """The ceramic's inverse at the points of the grid, then held inside window and slew [V/m, shape (N + 1,)].

    Without active limits its only miss is between the points of the grid. The current limit is not seen to.
    """
    ceramic = precise(problem)
    wanted = Signals(problem.grid, polarization=problem.set_point_at(problem.grid))
    _, out = ceramic.invert(initial_state(problem, ceramic), wanted)
    field = out.voltage / ceramic.layer_thickness
    if not math.isnan(problem.initial_field):
        field[0] = problem.initial_field
    field[0] = min(max(field[0], problem.field_min), problem.field_max)
    for k in range(1, field.size):
        low = max(problem.field_min, field[k - 1] - problem.field_step)
        high = min(problem.field_max, field[k - 1] + problem.field_step)
        field[k] = min(max(field[k], low), high)
    return field
