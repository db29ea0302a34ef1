"""The optimal field over one block of samples, from the state a ceramic is in: what a controller can afford each tick.

The branches are those that the guess runs along; the plan is then judged by the ceramic itself, so a plan that leaves
them is found out.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from pzt_ros.optimal import riccati
from pzt_ros.optimal.interval import FIELD, STAGE, X
from pzt_ros.optimal.law import NUMBERS, Material
from pzt_ros.optimal.memory import Memory, changes_of_branch, fraction_of, numbers_of, remembers
from pzt_ros.optimal.radau import NODES
from pzt_ros.optimal.structured import Planner
from pzt_ros.physics.link import State
from pzt_ros.physics.one_equation import OneEquation
from pzt_ros.physics.signals import Array, Signals


@dataclass(frozen=True)
class Start:
    """Where a block begins: the ceramic's state, and time [s] and field [V/m] of the last sample."""

    state: State
    time: float
    field: float


@dataclass(frozen=True)
class Limits:
    """Of a block: lowest and highest field [V/m], its fastest change [V/m/s], and the largest current [A]."""

    lowest: float
    highest: float
    slew_rate: float
    current: float


def optimal_block(
    ceramic: OneEquation, start: Start, time: Array, polarization: Array, guess: Array, limits: Limits, iterations: int
) -> Array | None:
    """The field [V/m, shape (n,)] at the samples of a block; None where none was found.

    Args:
        ceramic: parametrized.
        start: of the block.
        time: of the samples, evenly spaced [s, shape (n,)].
        polarization: that is wanted there [C/m^2, shape (n,)].
        guess: field inside the limits [V/m, shape (n,)].
        limits: to keep.
        iterations: at most.
    """
    count = time.size
    h = float(time[-1] - start.time) / count
    material = numbers_of(ceramic)
    laws, fractions = _along(ceramic, start, time, guess)
    first = start.field / material.reciprocal_permittivity + (2.0 * fractions[0] - 1.0) * material.domain_polarization
    asked = np.concatenate([[first], polarization])
    stages = asked[:-1, None] + NODES * np.diff(asked)[:, None]
    numbers = riccati.Numbers(
        h=h,
        lowest=min(limits.lowest, start.field),
        highest=max(limits.highest, start.field),
        step=limits.slew_rate * h,
        charge=limits.current * h / float(ceramic.electrode_area),
        initial_field=start.field,
        rate_weight=0.0,
        end_weight=0.0,
    )
    planner = Planner(material, numbers, np.hstack([laws, stages]), float(fractions[0]))
    planner.plan[:, FIELD] = np.concatenate([[start.field], guess])
    planner.plan[:, X] = fractions
    planner.plan[:-1, STAGE : STAGE + 3] = fractions[:-1, None] + NODES * np.diff(fractions)[:, None]
    cost, _, _ = planner.solve(iterations)
    field = planner.field[1:]
    return field.copy() if math.isfinite(cost) and bool(np.all(np.isfinite(field))) else None


@functools.cache
def rehearse() -> None:
    """Compile now what the first block at a limit would have to wait for."""
    numbers = riccati.Numbers(1e-4, -1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    law = np.array([1e6, 1e6, 1.0, 0.5, -1e6, 1e6, 1.0, 0.5, 0.0, 0.0, 0.0])
    Planner(Material(1e5, 1e-2, 0.2, 1e7), numbers, np.tile(law, (2, 1)), 0.5).solve(1)


def miss(ceramic: OneEquation, start: Start, time: Array, polarization: Array, field: Array) -> float:
    """The sum of (P - P_set)^2 over the samples under a field, by the ceramic itself [C^2/m^4]."""
    _, out = ceramic.step(start.state, Signals(time, field * ceramic.layer_thickness))
    return float(np.sum((out.polarization - polarization) ** 2))


def _along(ceramic: OneEquation, start: Start, time: Array, field: Array) -> tuple[Array, Array]:
    """Laws of the branches [shape (n, 8)], and x+ before the block and at its samples [shape (n + 1,)]."""
    voltage, begin = field * ceramic.layer_thickness, fraction_of(ceramic, start.state)
    if not remembers(ceramic):
        _, out = ceramic.step(start.state, Signals(time, voltage))
        laws = np.tile(Memory(ceramic, start.state).law(), (time.size, 1))
        return laws, np.concatenate([[begin], out.phase_fraction])
    state, rows, fractions = start.state, np.empty((time.size, NUMBERS)), np.full(time.size + 1, begin)
    turns = -1.0
    for k in range(time.size):
        state, out = ceramic.step(state, Signals(time[k : k + 1], voltage[k : k + 1]))
        if changes_of_branch(ceramic, state) != turns:
            turns, law = changes_of_branch(ceramic, state), Memory(ceramic, state).law()
        rows[k], fractions[k + 1] = law, out.phase_fraction[-1]
    return rows, fractions
