"""Coarse hat functions over a fine triangle of relays: few numbers, a smooth density (diagnosis-methods.md 1, b3).

A grid of N lines of thresholds has a node at every pair (l, m), m <= l: up at line l, down at m. Its hat is bilinear
in (a, b). Of the cell that the diagonal a = b cuts only the corner below is missing; half of its hat goes to either
neighbour on the diagonal, so that the hats still sum to 1 everywhere, none is negative, and all are continuous.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pzt_ros.physics.signals import Array


class Hats(NamedTuple):
    """Where the lines of thresholds lie in the coarse grid.

    Attributes:
        cell: number of the coarse line below each [shape (n,)].
        share: how far it is on the way to the next coarse line, 0 to 1 [shape (n,)].
        size: coarse lines N.
    """

    cell: NDArray[np.int64]
    share: Array
    size: int


def hats_of(lines: Array, grid: Array) -> Hats:
    """Hats on a coarse `grid` for `lines` within it, both ascending, in the same unit [shapes (n,), (N,)]."""
    cell = np.clip(np.searchsorted(grid, lines, side="right") - 1, 0, grid.size - 2)
    share = (lines - grid[cell]) / np.diff(grid)[cell]
    return Hats(cell.astype(np.int64), np.clip(share, 0.0, 1.0), int(grid.size))


def node_count(size: int) -> int:
    """Nodes of a grid of `size` lines."""
    return size * (size + 1) // 2


def nodes_of(size: int) -> list[tuple[int, int]]:
    """Line numbers (up, down) of every node, in order."""
    return [(up, down) for up in range(size) for down in range(up + 1)]


def relay_thresholds(lines: Array) -> tuple[Array, Array]:
    """Thresholds up and down of every relay, in the kernel's order [shape (n*n//4,)]."""
    up, down = _relay_lines(lines.size)
    return lines[up], lines[down]


@lru_cache(maxsize=8)
def _relay_lines(count: int) -> NDArray[np.int64]:
    """Numbers of the lines where every relay switches up and down [shape (2, n*n//4)]."""
    pairs = [(i, j) for i in range(1, count) for j in range((i + 1) % 2, i, 2)]
    return np.array(pairs, dtype=np.int64).T


@njit(cache=True, error_model="numpy", fastmath=True)
def accumulate(values, hats, work, sums, first_row=0, end_column=1 << 30):  # type: ignore[no-untyped-def]
    """Sum over relays of hat times value, for every node.

    First along a into whole rows, which is SIMD, then along b.

    Args:
        values: of every relay [shape (n*n//4,)].
        hats: the coarse grid.
        work: shape (N, 2, (n + 1)//2).
        sums: filled [shape (nodes,), float32 or float64].
        first_row, end_column: relays in rows before, and in columns from there on, are left out.
    """
    n = hats.cell.size
    work[:] = 0.0
    for i in range(max(first_row, 1), n):
        begin, odd = i * i // 4, (i + 1) % 2
        count = (min(i, end_column) - odd + 1) // 2
        r = values[begin : begin + count]
        s = hats.share[i]
        below = work[hats.cell[i], odd, :count]
        above = work[hats.cell[i] + 1, odd, :count]
        for k in range(count):
            below[k] += (1.0 - s) * r[k]
            above[k] += s * r[k]
    table = np.zeros((hats.size + 1, hats.size))  # (down, up), so that the inner loop is SIMD
    for j in range(min(n, end_column)):
        t = hats.share[j]
        here, after = table[hats.cell[j]], table[hats.cell[j] + 1]
        for up in range(hats.cell[j], hats.size):
            value = work[up, j % 2, j // 2]
            here[up] += (1.0 - t) * value
            after[up] += t * value
    begin = 0
    for up in range(hats.size):
        for down in range(up + 1):
            sums[begin + down] = table[down, up]
        sums[begin + up] += 0.5 * table[up + 1, up]  # the missing corner
        if up > 0:
            sums[begin + up] += 0.5 * table[up, up - 1]
        begin += up + 1


def gathered(values: Array, hats: Hats) -> Array:
    """Sum over relays of hat times value [unit of the values, shape (nodes,)].

    Args:
        values: of every relay [shape (n*n//4,)].
        hats: the coarse grid.
    """
    sums = np.empty(node_count(hats.size))
    accumulate(values, hats, np.zeros((hats.size, 2, (hats.cell.size + 1) // 2)), sums)
    return sums


@njit(cache=True, error_model="numpy", fastmath=True)
def spread_out(coefficients, hats, values):  # type: ignore[no-untyped-def]
    """The piecewise bilinear function with `coefficients` at the nodes, at every relay; transposed `accumulate`."""
    n = hats.cell.size
    for i in range(1, n):
        begin, count, odd = i * i // 4, (i + 1) // 2, (i + 1) % 2
        up, s = hats.cell[i], hats.share[i]
        low, high = up * (up + 1) // 2, (up + 1) * (up + 2) // 2
        for k in range(count):
            j = 2 * k + odd
            down, t = hats.cell[j], hats.share[j]
            if down < up:
                corner = coefficients[low + down + 1]
            else:
                corner = 0.5 * (coefficients[low + up] + coefficients[high + up + 1])
            values[begin + k] = (1.0 - s) * ((1.0 - t) * coefficients[low + down] + t * corner) + s * (
                (1.0 - t) * coefficients[high + down] + t * coefficients[high + down + 1]
            )


def hat_sums(hats: Hats) -> Array:
    """Sum over relays of each hat [-, shape (nodes,)]; one that no relay feels counts as 1."""
    sums = gathered(np.ones(hats.cell.size**2 // 4), hats)
    return np.where(sums > 0.0, sums, 1.0)
