"""Shares of domains between two fronts, with their profiles, from the Everett table: the compiled look-ups.

Fronts are not sharp: half of the domains within d or so of a front have switched. Each front therefore counts as two
hard sub-fronts (front_kinetics.front_table), and shares are averages over the 2 x 2 pairs. That is what makes narrow
densities and fast drives come out right. Lengths are in units of d. Everything is written for an up-going front at u
and a down-going one at l; with s = -1 the same functions serve turned positions, up and down exchanged.
"""

# ruff: noqa: E741 - u and l are the symbols of the Everett function

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pzt_ros.physics.front_kinetics import HIGH, LOW, SHARE, entry, inlined, inner, row_of
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, UPPER
from pzt_ros.physics.signals import Array


class Fronts(NamedTuple):
    """The material as the loops want it.

    Attributes:
        table: see front_kinetics.front_table.
        shares: see front_tables.Everett.values; the second half is the same for turned fields.
        per: grid steps per d.
        initial: share of domains up in the virgin state [-].
        per_volt: field [d] of a volt.
        attempt_rate: 1/tau [1/s].
        least_slope: dP/dV without switching [C/(m^2 V)].
        domain_polarization: P_T [C/m^2].
        bias: polarization that the interaction fields alone would make [C/m^2].
        layer_thickness: [m].
        dead_band: [d].
        field_step: longest substep [d].
        nearest: loops with both ends closer than this are one [d].
    """

    table: Array
    shares: Array
    per: float
    initial: float
    per_volt: float
    attempt_rate: float
    least_slope: float
    domain_polarization: float
    bias: float
    layer_thickness: float
    dead_band: float
    field_step: float
    nearest: float


@inlined
def _weights(t, t2, t3):  # type: ignore[no-untyped-def]
    """Cubic Hermite: of both values and of both slopes, from the place in the cell, its square and its cube."""
    value, slope = 3.0 * t2 - 2.0 * t3, t3 - t2
    return 1.0 - value, value, slope - t2 + t, slope


@inlined
def _mixed(w, s, t):  # type: ignore[no-untyped-def]
    """Mean weights of two places in one cell."""
    s2, t2 = s * s, t * t
    s3, t3 = s2 * s, t2 * t
    return _weights(t + w * (s - t), t2 + w * (s2 - t2), t3 + w * (s3 - t3))


@inlined
def _node(f, i, j, slope, b):  # type: ignore[no-untyped-def]
    """Value (slope = 0) or slope by u (1) at node i of u, with the weights b for the cell j of l."""
    m = j + np.uint64(1)
    return b[0] * f[i, j, slope] + b[1] * f[i, m, slope] + b[2] * f[i, j, slope + 2] + b[3] * f[i, m, slope + 2]


@inlined
def _contract(f, i, j, a, b):  # type: ignore[no-untyped-def]
    """Bicubic Hermite sum over a cell with the weights of u (a) and l (b)."""
    i, j = np.uint64(i), np.uint64(j)  # Numba spares the test for negative indices
    k = i + np.uint64(1)
    return (
        a[0] * _node(f, i, j, 0, b)
        + a[1] * _node(f, k, j, 0, b)
        + a[2] * _node(f, i, j, 1, b)
        + a[3] * _node(f, k, j, 1, b)
    )


@inner
def _hard(f, u, l):  # type: ignore[no-untyped-def]
    """A share for hard fronts at u and l [grid steps]."""
    if u <= l:
        return 0.0
    last = f.shape[1] - 1.0
    u, l = min(max(u, 0.0), last), min(max(l, 0.0), last)
    i, j = min(int(u), int(last) - 1), min(int(l), int(last) - 1)
    s, t = u - i, l - j
    return _contract(f, i, j, _weights(s, s * s, s * s * s), _weights(t, t * t, t * t * t))


@inner
def _row(f, i, a, l1, l2, v):  # type: ignore[no-untyped-def]
    """Mean over two hard fronts l with the weights a for the cell i of u."""
    j, m = int(l1), int(l2)
    s, t = l1 - j, l2 - m
    if j == m:
        return _contract(f, i, j, a, _mixed(v, s, t))
    first = _contract(f, i, j, a, _weights(s, s * s, s * s * s))
    return v * first + (1.0 - v) * _contract(f, i, m, a, _weights(t, t * t, t * t * t))


@inner
def _mean_of(f, u, l1, l2, v):  # type: ignore[no-untyped-def]
    """Mean over two hard fronts l, of weights v and the rest, for one at u [grid steps]."""
    if u >= max(l1, l2) and min(l1, l2) >= 0.0 and u < f.shape[1] - 1.0:
        i = int(u)
        s = u - i
        return _row(f, i, _weights(s, s * s, s * s * s), l1, l2, v)
    total = 0.0
    for l, b in ((l1, v), (l2, 1.0 - v)):  # with one call in a loop the code stays small: faster than two calls
        total += b * _hard(f, u, l)
    return total


@inner
def _mean(f, u1, u2, w, l1, l2, v):  # type: ignore[no-untyped-def]
    """Mean of four pairs of hard fronts: u1 has the weight w and u2 the rest, l1 v and l2 the rest [grid steps].

    Mostly both u or both l lie in a cell; one sum over it then does for both.
    """
    if min(u1, u2) >= max(l1, l2) and min(l1, l2) >= 0.0 and max(u1, u2) < f.shape[1] - 1.0 and int(u1) == int(u2):
        i = int(u1)
        return _row(f, i, _mixed(w, u1 - i, u2 - i), l1, l2, v)
    total = 0.0
    for u, a in ((u1, w), (u2, 1.0 - w)):
        total += a * _mean_of(f, u, l1, l2, v)
    return total


@inner
def section(f, i, l1, l2, v):  # type: ignore[no-untyped-def]
    """The mean over two hard fronts l [grid steps] within the cell i of u: coefficients of a cubic in the place."""
    last = f.shape[1] - 1.0
    k = np.uint64(i)
    y0 = y1 = m0 = m1 = 0.0
    for l, w in ((l1, v), (l2, 1.0 - v)):
        l = min(max(l, 0.0), last)
        j = min(int(l), int(last) - 1)
        t = l - j
        b = _weights(t, t * t, t * t * t)
        j = np.uint64(j)
        y0 += w * _node(f, k, j, 0, b)
        y1 += w * _node(f, k + np.uint64(1), j, 0, b)
        m0 += w * _node(f, k, j, 1, b)
        m1 += w * _node(f, k + np.uint64(1), j, 1, b)
    e = y1 - y0
    return y0, m0, 3.0 * e - 2.0 * m0 - m1, m0 + m1 - 2.0 * e


@inlined
def places(table, lead):  # type: ignore[no-untyped-def]
    """Where the two sub-fronts of a front are relative to it, and the share of the first."""
    k, t = row_of(table, lead)
    return entry(table, k, t, LOW), entry(table, k, t, HIGH), entry(table, k, t, SHARE)


@inlined
def everett(shares, per, u, profile, l, profile_l):  # type: ignore[no-untyped-def]
    """T of fronts with profiles [-], in the shares of their direction."""
    u1, u2, w = profile
    l1, l2, v = profile_l
    middle = 0.5 * (shares.shape[1] - 1)
    at, at_l = middle + u * per, middle + l * per
    return _mean(shares[TRIANGLE], at + u1 * per, at + u2 * per, w, at_l - l1 * per, at_l - l2 * per, v)


@inlined
def between(shares, half, per, u, profile, field):  # type: ignore[no-untyped-def]
    """Share of the domains between a front and its mirror image at the field: the far half (LOWER) is down, the near
    half (UPPER) up [-].

    The far half of this and of the same for the mirrored front add up to T: the two may change roles without a jump.
    """
    u1, u2, w = profile
    u1, u2 = (u - field + u1) * per, (u - field + u2) * per
    if max(u1, u2) <= 0.0 and min(u1, u2) <= 0.0:
        return 0.0
    at = 0.5 * (shares.shape[1] - 1) + field * per
    return _mean(shares[half], at + u1, at + u2, w, at - u1, at - u2, w)


@inner
def _virgin_curve(f, u):  # type: ignore[no-untyped-def]
    """x - initial of a hard front at u [grid steps] that comes from the virgin state."""
    return _hard(f[LOWER], u, f.shape[1] - 1.0 - u)


@inner
def virgin_share(f, l1, l2, v):  # type: ignore[no-untyped-def]
    """Of what the hard fronts l [grid steps] took up on a way down from the virgin state, the mean: it comes back."""
    last = f.shape[1] - 1.0
    return v * _hard(f[UPPER], last - l1, l1) + (1.0 - v) * _hard(f[UPPER], last - l2, l2)


@inner
def _hard_first_leg(f, u, l):  # type: ignore[no-untyped-def]
    """x - initial of hard fronts [grid steps] in a virgin specimen: first down to l, then up to u."""
    back = f.shape[1] - 1.0 - l
    return _virgin_curve(f, u) if u > back else _hard(f[TRIANGLE], u, l) - _hard(f[UPPER], back, l)


@inner
def first_leg(f, per, u, profile, l, profile_l):  # type: ignore[no-untyped-def]
    """What the way up to u adds to x where all before was a way down to l from the virgin state."""
    middle = 0.5 * (f.shape[1] - 1)
    u1, u2, w = middle + (u + profile[0]) * per, middle + (u + profile[1]) * per, profile[2]
    l1, l2, v = middle + (l - profile_l[0]) * per, middle + (l - profile_l[1]) * per, profile_l[2]
    if min(u1, u2) > 2.0 * middle - min(l1, l2):
        return w * _virgin_curve(f, u1) + (1.0 - w) * _virgin_curve(f, u2)
    total = 0.0
    for at, a in ((u1, w), (u2, 1.0 - w)):
        for at_l, b in ((l1, v), (l2, 1.0 - v)):
            total += a * b * _hard_first_leg(f, at, at_l)
    return total


@inner
def leg(fr, k, s, u, lead, l, lead_l):  # type: ignore[no-untyped-def]
    """What the way from turning point k - 1 (at l) to k (at u) adds to x, in turned positions."""
    f = fr.shares[0] if s > 0.0 else fr.shares[1]
    profile, profile_l = places(fr.table, lead), places(fr.table, lead_l)
    if k > 1:
        return s * everett(f, fr.per, u, profile, l, profile_l)
    return s * first_leg(f, fr.per, u, profile, l, profile_l)
