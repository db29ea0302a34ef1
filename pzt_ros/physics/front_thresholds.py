"""The Everett function of an identified density of thresholds, for the front model.

With the density mu(a, b) of domains that switch up at a and down at b, a >= b, and the integrals

    G(a, b) = int_-inf^b mu(a, y) dy,        I(u, l) = int_l^u mu(u, y) dy = G(u, u) - G(u, l),

the share of the domains with a < u and b > l is T(u, l) = int_l^u I(a, l) da. Its half below the line a + b = u + l is
the integral of I along the way on which the triangle grows about its middle, int_0^c I(m + x, m - x) dx; c = (u - l)/2,
m = (u + l)/2. mu is bilinear in cells, so G and its integral over a are sums of products of known functions of a and b.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from numba import njit

from pzt_ros.physics.density import ThresholdDensity
from pzt_ros.physics.front_tables import KEPT, LOWER, MAX_POINTS, TRIANGLE, Everett, beyond_diagonal, finished
from pzt_ros.physics.signals import Array

_FINER = 4
"""Steps of the table to a cell of the density: kinks then cost less than 1e-4 of x+."""


@functools.lru_cache(maxsize=KEPT)
def everett_of(density: ThresholdDensity) -> Everett:
    """Tabulate the Everett function of an identified density."""
    reach = max(abs(density.up_fields[-1]), abs(density.down_fields[0]))
    step = max(density.spacing / _FINER, 2 * reach / MAX_POINTS)
    half = math.ceil(reach / step) + 1
    points = 2 * half + 1
    fine: Array = np.arange(-4 * half, 4 * half + 1, dtype=np.float64) * (step / 4)
    weights = np.asarray(density.weights)
    up, up_sum = _hats(np.asarray(density.up_fields), fine)
    down, down_sum = _hats(np.asarray(density.down_fields), fine)
    mu = up @ weights @ down.T
    values = np.zeros((2, 3, points, points, 4))
    whole = up_sum @ weights @ down_sum.T
    _fill(values[0], mu, up @ weights @ down_sum.T, up_sum @ weights @ down.T, whole, np.gradient(mu, axis=1), step)
    tip = 2.0 * np.diagonal(mu)[::-1]
    for share, part in ((TRIANGLE, 1.0), (LOWER, 0.5)):
        beyond_diagonal(values[0, share], part, tip, np.gradient(tip, step / 4), step)
    values /= values[0, TRIANGLE, -1, 0, 0]
    finished(values)
    inside = np.tril(mu) - 0.5 * np.diag(np.diagonal(mu))
    middle = -0.5 * float(np.sum(inside * (fine[:, None] + fine)) / np.sum(inside))
    initial = 1.0 - float(values[0, LOWER, -1, 0, 0])
    return Everett(values, step, half * step, initial, middle)


def _hats(fields: Array, at: Array) -> tuple[Array, Array]:
    """The hat function of each field, 0 outside all fields, and its integral from below [V/m]; a column per field.

    The hats are means over the steps of `at`: sums over them are then exact, even where a density ends with a jump.
    """
    step = at[1] - at[0]
    edges = np.append(at - step / 2, at[-1] + step / 2)
    return np.diff(_hat_sums(fields, edges), axis=0) / step, _hat_sums(fields, at)


def _hat_sums(fields: Array, at: Array) -> Array:
    sums = np.zeros((at.size, fields.size))
    for k, gap in enumerate(np.diff(fields)):
        part = np.clip((at - fields[k]) / gap, 0.0, 1.0)
        sums[:, k] += gap * (part - 0.5 * part**2)
        sums[:, k + 1] += gap * 0.5 * part**2
    return sums


@njit(cache=True, error_model="numpy", nogil=True)
def _fill(values, mu, below, before, whole, change, step):  # type: ignore[no-untyped-def]
    """TRIANGLE and LOWER with slopes for u >= l, from integrals on quarter steps.

    mu over b is `below`, over a `before`, over both `whole`; `change` is that of mu with b over a quarter step.
    """
    n = values.shape[1]
    triangle, lower = values[TRIANGLE], values[LOWER]
    rule = (step / 8, step / 4, step / 8)  # no better one: it is exact for means
    along = np.zeros(4 * n - 3)  # the integral of G(a, a)
    for m in range(2, along.size, 2):
        along[m] = along[m - 2] + rule[0] * (below[m - 2, m - 2] + below[m, m]) + rule[1] * below[m - 1, m - 1]
    for i in range(n):
        for j in range(i):
            u, l, m = 4 * i, 4 * j, 2 * (i + j)  # noqa: E741
            by_u, by_l = below[u, u] - below[u, l], before[u, l] - before[l, l]
            triangle[i, j, 0] = along[u] - along[l] - (whole[u, l] - whole[l, l])
            triangle[i, j, 1], triangle[i, j, 2] = step * by_u, -step * by_l
            triangle[i, j, 3] = -step * step * mu[u, l]
            g = d = turn = 0.0
            for k in range(i - j):
                for r in range(3):
                    x = 2 * k + r
                    g += rule[r] * below[m + x, m - x]
                    d += rule[r] * mu[m + x, m - x]
                    turn += rule[r] * change[m + x, m - x] / (0.25 * step)
            lower[i, j, 0] = along[u] - along[m] - g
            lower[i, j, 1], lower[i, j, 2] = step * (by_u - d), -step * d
            lower[i, j, 3] = step * step * (0.5 * mu[m, m] - mu[u, l] - turn)
