"""What the front model looks up: the Everett function of a polycrystal, and the profile of a switching front.

Fields are thresholds here: a domain (E_c, E_e) switches up at a = E_c - E_e and down at b = -E_c - E_e. The Everett
function T(u, l) is the share of domains with a < u and b > l, a triangle in the (E_c, E_e) plane: its base is E_c = 0,
its tip lies at E_c = c = (u - l)/2, E_e = m = -(u + l)/2. The line through the tip that halves it, E_e = m, separates

    upper(c, m) = int_0^c f1(x) [F2(m + c - x) - F2(m)] dx,    lower(c, m) = int_0^c f1(x) [F2(m) - F2(m - c + x)] dx.

Any densities f1 of E_c and f2 of E_e will do. The tables know neither rate nor temperature, so parameter sets that
share the densities share the table; one costs 0.1 to 0.3 ms where the spreads are alike.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import special

from pzt_ros.physics.density import Density, Gaussian, Table
from pzt_ros.physics.signals import Array

CUT = 5.0
"""Standard deviations kept of a Gaussian."""

_POINTS_PER_SIGMA = 4.0
_MAX_CELLS = 384
"""In the direction of c; it bounds memory to 20 MB where one spread is far below the other."""


class Everett(NamedTuple):
    """The Everett function on a grid, for bicubic Hermite interpolation.

    Attributes:
        cells: shape (nc + 1, 2 nm + 1, 8); of sum and of lower - upper each: value, times the spacing d/dc, d/dm, d2/dc dm.
        spacing_c, spacing_m: of the grid [V/m]; c starts at 0, m at -nm spacing_m.
        reach: no domain switches beyond +-reach [V/m].
        initial: share of the domains with E_e >= 0, which a virgin specimen has up [-].
        mean: of the interaction field [V/m].
    """

    cells: Array
    spacing_c: float
    spacing_m: float
    reach: float
    initial: float
    mean: float


@functools.lru_cache(maxsize=64)
def everett(coercive: Density, interaction: Density) -> Everett:
    """Tabulate the Everett function of two independent densities; a spread narrower than 3 cells is widened to that."""
    narrowest = min(_sigma(coercive), _sigma(interaction))
    step = max(narrowest / _POINTS_PER_SIGMA, _reach(coercive, interaction) / _MAX_CELLS)
    coercive, interaction = _widened(coercive, 3 * step), _widened(interaction, 3 * step)
    reach = _reach(coercive, interaction)
    ratio = max(1, int(_sigma(interaction) / _POINTS_PER_SIGMA / step + 1e-9))
    rows_m = math.ceil(reach / (step * ratio)) + 1
    rows_c = math.ceil(reach / step) + 1

    half = np.arange(2 * rows_c + 1) * (step / 2)
    f1, _ = _sampled(coercive, half)
    count = 2 * (rows_m * ratio + rows_c)
    v = np.arange(-count, count + 1) * (step / 2)
    f2, F2 = _sampled(interaction, v)
    cells = np.zeros((rows_c + 1, 2 * rows_m + 1, 8))
    _fill(cells, f1, f2, F2, np.gradient(f2), step, ratio)
    mean = float(np.sum(v * f2) / np.sum(f2))
    initial = 1.0 - float(F2[count])
    return Everett(cells, step, step * ratio, reach, initial, mean)


def _sigma(density: Density) -> float:
    if isinstance(density, Gaussian):
        return density.sigma
    share = (np.arange(64) + 0.5) / 64
    return float(np.std(density.quantile(share)))


def _reach(coercive: Density, interaction: Density) -> float:
    """The highest field at which a domain switches [V/m]."""
    (_, highest), ends = (d.support(CUT) if d.spread > 0 else (d.peak, d.peak) for d in (coercive, interaction))
    return highest + max(abs(ends[0]), abs(ends[1]))


def _widened(density: Density, sigma: float) -> Density:
    if not isinstance(density, Gaussian) or density.sigma >= sigma:
        return density
    return Gaussian(density.peak, 2 * sigma**2, density.lower)


def _sampled(density: Density, grid: Array) -> tuple[Array, Array]:
    """Density and cumulative share on an even grid."""
    if isinstance(density, Gaussian):
        below = special.ndtr((grid - density.centre) / density.sigma)
        return density.at(grid), np.maximum(below - (1.0 - density.mass), 0.0) / density.mass
    # a table may have features below the spacing: what counts is the share between two points
    step = grid[1] - grid[0]
    edges = np.concatenate((grid - step / 2, [grid[-1] + step / 2]))
    edges[0] = max(edges[0], grid[0])
    cumulative = _cumulative(density, edges)
    return np.diff(cumulative) / np.diff(edges), _cumulative(density, grid)


def _cumulative(density: Table, fields: Array) -> Array:
    """Share of the domains below each field [-], exact: the density is linear between the fields of the table."""
    known = np.asarray(density.field)
    every = np.union1d(known, np.clip(fields, known[0], known[-1]))
    at = density.at(every)
    sums = np.concatenate(([0.0], np.cumsum(np.diff(every) * (at[1:] + at[:-1]) / 2)))
    return np.interp(fields, every, sums)


@njit(cache=True, error_model="numpy")
def _fill(cells, f1, f2, F2, change2, step, ratio):  # type: ignore[no-untyped-def]
    """Integrals from 0 to c by Simpson's rule; f1 on half steps from 0, the others on half steps around 0.

    int_0^c f1(x) g(v - x) dx for all v = m + c grows row by row, and so does int_0^c f1(x) g(v + x) dx for v = m - c.
    """
    rows, columns = cells.shape[0], cells.shape[1]
    nm = columns // 2
    reach = nm * ratio + rows
    middle = F2.size // 2
    grown = np.zeros((6, 2 * reach + 1))
    sum_f1 = 0.0
    step_m = step * ratio
    for i in range(rows):
        if i > 0:
            w0, w1, w2 = step / 6 * f1[2 * i - 2], step / 6 * 4 * f1[2 * i - 1], step / 6 * f1[2 * i]
            sum_f1 += w0 + w1 + w2
            for v in range(-reach + i, reach - i + 1):
                k, below, above = v + reach, middle + 2 * v - 2 * i, middle + 2 * v + 2 * i
                grown[0, k] += w0 * F2[below + 2] + w1 * F2[below + 1] + w2 * F2[below]
                grown[1, k] += w0 * f2[below + 2] + w1 * f2[below + 1] + w2 * f2[below]
                grown[2, k] += w0 * change2[below + 2] + w1 * change2[below + 1] + w2 * change2[below]
                grown[3, k] += w0 * F2[above - 2] + w1 * F2[above - 1] + w2 * F2[above]
                grown[4, k] += w0 * f2[above - 2] + w1 * f2[above - 1] + w2 * f2[above]
                grown[5, k] += w0 * change2[above - 2] + w1 * change2[above - 1] + w2 * change2[above]
        for j in range(-nm, nm + 1):
            if abs(j) * ratio + i > reach - i:
                continue  # no domain beyond; nobody looks there
            m = middle + 2 * ratio * j
            g = grown[:, ratio * j + i + reach]
            h = grown[:, ratio * j - i + reach]
            upper, upper_c, upper_cm = g[0] - F2[m] * sum_f1, g[1], g[2]
            lower, lower_c, lower_cm = F2[m] * sum_f1 - h[3], h[4], h[5]
            upper_m, lower_m = g[1] - f2[m] * sum_f1, f2[m] * sum_f1 - h[4]
            mixed = 2.0 * step_m  # `change2` is per half step
            put = cells[i, nm + j]
            put[0], put[4] = upper + lower, lower - upper
            put[1], put[5] = step * (upper_c + lower_c), step * (lower_c - upper_c)
            put[2], put[6] = step_m * (upper_m + lower_m), step_m * (lower_m - upper_m)
            put[3], put[7] = mixed * (upper_cm + lower_cm), mixed * (lower_cm - upper_cm)
