"""What the front model looks up: the Everett function of a polycrystal.

Fields are thresholds here: a domain (E_c, E_e) switches up at a = E_c - E_e and down at b = -E_c - E_e. The Everett
function T(u, l) is the share of domains with a < u and b > l, a triangle in the (E_c, E_e) plane: its base is E_c = 0,
its tip lies at E_c = c = (u - l)/2, E_e = m = -(u + l)/2. The line E_e = m through the tip halves it:

    T(u, l) = int_0^c f1(x) [F2(-l - x) - F2(x - u)] dx,        lower(u, l) = int_0^c f1(x) [F2(m) - F2(x - u)] dx.

Any densities f1 of E_c and f2 of E_e will do. The table knows neither rate nor temperature, so parameter sets that
share the densities share the table; one costs about 0.2 ms where the spreads are alike, a few ms where they are not.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from pzt_ros.errors import BenchError
from pzt_ros.physics.compiling import OUTER
from pzt_ros.physics.density import Density, Table
from pzt_ros.physics.kinds import Kind
from pzt_ros.physics.signals import Array

CUT = 5.0
"""Standard deviations kept of a Gaussian."""

_STEP = 0.5
"""Grid step over the narrower standard deviation: interpolation is then good to 1e-5."""

MAX_POINTS = 384
"""Along an axis; it bounds a table to 28 MB where one spread is far below the other."""

_FARTHEST = 250
"""Steps from the middle to an end, at most.

Where coercive fields are widened, interaction fields that grow with them are, too, and reach far beyond what MAX_POINTS
has allowed for: a fit that came by there asked for 1 TiB (court, seed 1833).
"""

KEPT = 16
"""Tables: for four candidates that are refitted side by side, each with what its differences ask for."""

TRIANGLE, LOWER, UPPER = map(np.int64, range(3))
"""Which share: of the triangle, of its half below the line through the tip, of that above.

Numba compiles a function anew for each plain integer that it is called with, but not for these.
"""


class Everett(NamedTuple):
    """The Everett function on a grid, for bicubic Hermite interpolation.

    Attributes:
        values: shape (2, 3, n, n, 4): of TRIANGLE, LOWER, UPPER, for every u and l, the value and, times the step, its
            derivatives by u, by l, and by both; then the same as a front sees it that moves down, in turned fields.
        step: of the grid [V/m].
        reach: the grid goes from -reach to reach [V/m]; no domain switches beyond.
        initial: share of the domains with E_e >= 0, which a virgin specimen has up [-].
        mean: of the interaction field [V/m].
    """

    values: Array
    step: float
    reach: float
    initial: float
    mean: float


@functools.lru_cache(maxsize=KEPT)
def everett(kinds: tuple[Kind, ...]) -> Everett:
    """Tabulate the Everett function of some kinds of domains; a spread below 2 steps of the grid is widened.

    Raises:
        BenchError: interaction fields grow so much with the coercive ones that no table holds both.
    """
    narrowest = min(_sigma(density) for kind in kinds for density in (kind.coercive, kind.interaction))
    step = max(_STEP * narrowest, 2 * _reach(kinds) / MAX_POINTS)
    kinds = tuple(kind.widened(2 * step) for kind in kinds)
    half = math.ceil(_reach(kinds) / step)
    if half > _FARTHEST:
        raise BenchError(
            f"front: domains switch at up to {_reach(kinds):.3g} V/m, too far for a table with steps of {step:.3g} V/m;"
            " lower interaction_field_growth, or raise coercive_field, where that is far below its spread"
        )
    points = 2 * half + 1
    barriers: Array = np.arange(4 * half + 1, dtype=np.float64) * (step / 4)
    fields: Array = np.arange(-4 * half, 4 * half + 1, dtype=np.float64) * (step / 4)
    parts = [kind.sampled(barriers, fields) for kind in kinds]
    density, below = (np.sum([part[k] for part in parts], axis=0) for k in (0, 1))
    change = np.gradient(density, step / 4, axis=1)
    values = np.zeros((2, 3, points, points, 4))
    _fill(values[0], density, below, *(_within(each, step) for each in (density, below, change)), change, step)
    finished(values)
    down, whole, field, weight = _within(
        np.column_stack((below[:, 4 * half], below[:, -1], density @ fields, density.sum(axis=1))), step
    )[-1]
    return Everett(values, step, half * step, float(1.0 - down / whole), float(field / weight))


def _sigma(density: Density) -> float:
    if not isinstance(density, Table):
        return density.sigma
    share = (np.arange(64) + 0.5) / 64
    return float(np.std(density.quantile(share)))


def _reach(kinds: Sequence[Kind]) -> float:
    """The highest field at which a domain switches [V/m]."""
    ends = np.array([kind.ends(CUT) for kind in kinds])
    return float(np.max(ends[:, 1] + np.abs(ends[:, 2:]).max(axis=1)))


def _within(of_barriers: Array, step: float) -> Array:
    """Integrals over the barrier from 0 to every half step, by Simpson's rule on quarter steps."""
    pairs = (of_barriers[:-2:2] + 4 * of_barriers[1:-1:2] + of_barriers[2::2]) * (step / 12)
    return np.concatenate((np.zeros_like(pairs[:1]), np.cumsum(pairs, axis=0)))


@njit(**OUTER, error_model="numpy", nogil=True)
def _fill(values, f, F, f_within, F_within, change_within, change, step):  # type: ignore[no-untyped-def]
    """Integrals over the barrier by Simpson's rule; rows on quarter steps from 0, columns from -reach.

    They grow along the grid, int f(x, -l - x) dx with u, int f(x, x - u) dx as l falls, by one rule a point. F is the
    integral of f over E_e from below, the others are those of f, F and df/dE_e from 0 to every half step.
    """
    n = values.shape[1]
    triangle, lower = values[TRIANGLE], values[LOWER]
    rule = (step / 12, step / 3, step / 12)
    for j in range(n):
        at = 4 * (n - 1 - j)  # of -l
        share = slope = 0.0
        for i in range(j + 1, n):
            for k in range(3):
                x = 2 * (i - 1 - j) + k
                share += rule[k] * F[x, at - x]
                slope += rule[k] * f[x, at - x]
            triangle[i, j, 0], triangle[i, j, 2] = share, -step * slope
    for i in range(n):
        at = 4 * (n - 1 - i)  # of -u
        share = slope = 0.0
        for j in range(i, -1, -1):
            if j < i:
                for k in range(3):
                    x = 2 * (i - 1 - j) + k
                    share += rule[k] * F[x, at + x]
                    slope += rule[k] * f[x, at + x]
            c, m = i - j, 4 * (n - 1) - 2 * (i + j)
            tip = f[2 * c, m]
            triangle[i, j, 0] -= share
            triangle[i, j, 1] = step * slope
            triangle[i, j, 3] = -0.5 * step * step * tip
            median = 0.5 * step * f_within[c, m]
            lower[i, j, 0] = F_within[c, m] - share
            lower[i, j, 1] = step * slope - median
            lower[i, j, 2] = -median
            lower[i, j, 3] = 0.25 * step * step * (change_within[c, m] - tip)
    beyond_diagonal(triangle, 1.0, f[0], change[0], step)
    beyond_diagonal(lower, 0.5, f[0], change[0], step)


def finished(values: Array) -> None:
    """Fill in UPPER, and the shares in turned fields: u stands where -l stood, and the halves change their names."""
    straight, turned = values
    np.subtract(straight[TRIANGLE], straight[LOWER], out=straight[UPPER])
    for share, source in ((TRIANGLE, TRIANGLE), (LOWER, UPPER), (UPPER, LOWER)):
        there, here = straight[source, ::-1, ::-1].swapaxes(0, 1), turned[share]
        for column, (sign, other) in enumerate(((1, 0), (-1, 2), (-1, 1), (1, 3))):
            np.multiply(there[..., other], sign, out=here[..., column])


@njit(**OUTER, error_model="numpy")
def beyond_diagonal(values, start, f2, change2, step):  # type: ignore[no-untyped-def]
    """The points just beyond the diagonal, so that cells on it are as smooth as the others.

    Towards c = 0 a share is A c^2 + B c^3, with A = start f2(m): at -c it is 2 A c^2 minus that at c.
    """
    n = values.shape[0]
    c = 0.5 * step
    for i in range(n - 1):
        m = 4 * (n - 1) - 2 * (2 * i + 1)
        A, dA = start * f2[m], start * change2[m]
        here = values[i + 1, i]
        values[i, i + 1, 0] = 2.0 * A * c * c - here[0]
        values[i, i + 1, 1] = -here[2] - step * (2.0 * A * c + dA * c * c)
        values[i, i + 1, 2] = -here[1] + step * (2.0 * A * c - dA * c * c)
        values[i, i + 1, 3] = -here[3] - step * step * A
