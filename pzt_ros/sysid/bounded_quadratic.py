"""The least point of a convex quadratic form in a box, dense and some hundred coordinates wide.

A primal-dual interior point method with Mehrotra's predictor and corrector (Nocedal and Wright, Numerical Optimization,
16.6) finds in some fifteen rounds which coordinates press against their bounds; the others then solve their equations,
and what that shows to be wrong is corrected.
Projected Newton steps, which hold and let go coordinates as they meet bounds, took hundreds of rounds where the columns
of a density's weights and those of unknown histories are nearly alike.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import linalg

from pzt_ros.physics.signals import Array

_linalg: Any = linalg  # SciPy carries no types

_ROUNDS, _CORRECTIONS = 60, 6
_GAP, _UNBALANCED = 1e-13, 1e-10  # of cost and of gradient: what is left when it ends
_NOTHING = 1e-20  # of the first gap, where the least cost is 0
_SHORT_OF_BOUNDS = 0.995
_INTO = np.array([[1.0], [-1.0]])  # from the low and from the high bound into the box
_LEAST_SLACK = 1e-100  # a force over less than that is no number any more
_INWARDS = 0.25  # share of a coordinate's range from which it starts, at least


def bounded_minimum(gram: Array, gradient: Array, low: Array, high: Array) -> Array:
    """The vector s within low <= s <= high of least s'Gs/2 + g's, G positive definite.

    Coordinates that press against a bound are on it to the bit.

    Args:
        gram, gradient: G [shape (p, p)], about 1 on its diagonal, and g [shape (p,)].
        low, high: bounds around 0 [shape (p,)], infinite where there is none.
    """
    step = np.clip(np.zeros(gradient.size), low, high)
    inside = low < high
    if np.any(inside):
        rest = gradient[inside] + gram[np.ix_(inside, ~inside)] @ step[~inside]
        step[inside] = _minimum(gram[np.ix_(inside, inside)], rest, low[inside], high[inside])
    return step


def _minimum(gram: Array, gradient: Array, low: Array, high: Array) -> Array:
    step = _solved(gram, -gradient)
    if np.all((low <= step) & (step <= high)):
        return step
    step, held = _interior(gram, gradient, np.stack([low, high]))
    best = np.clip(step, low, high)
    for _ in range(_CORRECTIONS):
        step = np.where(held < 0, low, np.where(held > 0, high, 0.0))
        free = held == 0
        if np.any(free):
            pull = gradient[free] + gram[np.ix_(free, ~free)] @ step[~free]
            step[free] = _solved(gram[np.ix_(free, free)], -pull)
        better = np.clip(step, low, high)
        if _cost(gram, gradient, better) > _cost(gram, gradient, best):
            break
        best, before, slope = better, held, gram @ step + gradient
        held = np.where(free, 1 * (step > high) - 1 * (step < low), np.where(held * slope > 0.0, 0, held))
        if np.array_equal(held, before):
            break
    return best


def _cost(gram: Array, gradient: Array, step: Array) -> float:
    return float(0.5 * step @ gram @ step + gradient @ step)


def _interior(gram: Array, gradient: Array, bounds: Array) -> tuple[Array, Array]:
    """A point next to the minimum, and whether each coordinate presses there against its low bound, -1, or high, 1.

    Each bound has a slack and a force (its multiplier), whose product is led to 0; in the end all forces balance.
    """
    there, scale = np.isfinite(bounds), float(np.max(np.abs(gradient)))
    inwards = np.minimum(_INWARDS * (bounds[1] - bounds[0]), scale)
    step = np.clip(np.zeros(gradient.size), bounds[0] + inwards, bounds[1] - inwards)
    slack, force = np.where(there, _INTO * (step - bounds), 1.0), np.where(there, scale, 0.0)
    slack = np.maximum(slack, _LEAST_SLACK)
    nothing = _NOTHING * float(np.sum(slack * force))
    for _ in range(_ROUNDS):
        unbalanced = gram @ step + gradient - np.sum(_INTO * force, axis=0)
        gap = float(np.sum(slack * force))
        if gap <= nothing + _GAP * abs(float(gradient @ step)) and np.max(np.abs(unbalanced)) <= _UNBALANCED * scale:
            break
        factor = _linalg.cho_factor(gram + np.diag(np.sum(force / slack, axis=0)), check_finite=False)
        straight = _towards(factor, 0.0 * slack, slack, force, unbalanced)  # the predictor
        share = _possible(slack, force, *straight[:2])
        reached = float(np.sum((slack + share * straight[0]) * (force + share * straight[1])))
        centre = (reached / gap) ** 3 * gap / np.count_nonzero(there)
        product = there * (centre - straight[0] * straight[1])
        ways = _towards(factor, product, slack, force, unbalanced)
        share = _SHORT_OF_BOUNDS * _possible(slack, force, *ways[:2])
        slack, force, step = (value + share * way for value, way in zip((slack, force, step), ways, strict=True))
        slack = np.maximum(slack, _LEAST_SLACK)
    presses = there & (force > np.diag(gram) * slack) & (force >= force[::-1])
    return step, 1 * presses[1] - 1 * presses[0]


def _towards(factor: Any, product: Array, slack: Array, force: Array, unbalanced: Array) -> tuple[Array, Array, Array]:
    """How slack, force and coordinates change in a Newton step to these products of slack and force, and to balance."""
    pull = product / slack - force
    way = _linalg.cho_solve(factor, np.sum(_INTO * pull, axis=0) - unbalanced, check_finite=False)
    opened = _INTO * way * (force > 0.0)  # where there is no bound, there is no force
    return opened, pull - force * opened / slack, way


def _possible(slack: Array, force: Array, opened: Array, pressed: Array) -> float:
    """The longest share of a step that leaves slacks and forces positive."""
    values, ways = np.concatenate((slack, force)), np.concatenate((opened, pressed))
    shrinks = ways < 0.0
    return min(1.0, float(np.min(-values[shrinks] / ways[shrinks], initial=np.inf)))


def _solved(gram: Array, right: Array) -> Array:
    solution: Array = _linalg.cho_solve(_linalg.cho_factor(gram, check_finite=False), right, check_finite=False)
    return solution
