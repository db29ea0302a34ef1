"""A broken line through what a periodic scan shows: its corners lie close together behind the turns of the reference.

A stage errs most suddenly just after it has turned and smoothly from there on, so such a line needs few corners. It is
the line of least squares: noise and the least step of a sensor are averaged over all samples between two corners, and
nothing in it depends on a threshold. (Projection on basis functions in learning control: van de Wijdeven and Bosgra,
Int. J. Control 83, 2010.)
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pzt_ros.physics.signals import Array

_GROWTH = 1.5
"""From the distance of two corners to the next, behind a turn."""

_TURN = 0.01
"""Of its peak to peak, by which a reference has to come back for a turn."""

_MOST_TURNS = 16
"""In a period; a reference that turns more often has its corners evenly spaced."""

Places = NDArray[np.int64]
"""Samples of the period."""


def corners(reference: Array, closest: float, widest: float) -> Places:
    """Where the corners lie, increasing [shape (m,)].

    Args:
        reference: of one period [shape (n,)].
        closest: distance of the first two behind a turn, in samples; at least 1 counts.
        widest: distance to which it grows, in samples.
    """
    size = reference.size
    turns = _turns(reference, _TURN * float(np.ptp(reference)))
    if turns.size > _MOST_TURNS:
        turns, closest = turns[:1], widest
    found = []
    for begin, end in zip(turns, np.append(turns[1:], turns[0] + size), strict=True):
        behind, gap = 0.0, max(closest, 1.0)
        while begin + behind + 0.5 * min(gap, widest) < end:
            found.append((begin + round(behind)) % size)
            behind += min(gap, widest)
            gap *= _GROWTH
    return np.unique(found)


def line_through(values: Array, at: Places) -> Array:
    """The broken line of least squares through periodic values [shape (n,)], with its corners at `at` [shape (m,)]."""
    size, count = values.size, at.size
    if count < 2:
        return np.full(size, values.mean())
    place = np.arange(size)
    left = (np.searchsorted(at, place, side="right") - 1) % count
    right = (left + 1) % count
    part = ((place - at[left]) % size) / ((at[right] - at[left]) % size)
    normal = np.zeros((count, count))
    np.add.at(normal, (left, left), (1.0 - part) ** 2)
    np.add.at(normal, (right, right), part**2)
    np.add.at(normal, (left, right), part * (1.0 - part))
    np.add.at(normal, (right, left), part * (1.0 - part))
    moments = np.bincount(left, (1.0 - part) * values, count) + np.bincount(right, part * values, count)
    heights = np.linalg.solve(normal, moments)
    line: Array = (1.0 - part) * heights[left] + part * heights[right]
    return line


@njit(cache=True)
def _turns(reference: Array, least: float) -> Places:
    """The lowest sample of a period and the turns after it, in the order of time; the indices run on beyond its end."""
    size, first = reference.size, int(np.argmin(reference))
    found = [first]
    extreme, upwards = first, True
    for k in range(first + 1, first + size):
        beyond = reference[k % size] - reference[extreme % size]
        if not upwards:
            beyond = -beyond
        if beyond > 0.0:
            extreme = k
        elif beyond < -least:
            found.append(extreme)
            extreme, upwards = k, not upwards
    return np.array(found)
