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
from numba import njit

from pzt_ros.physics.front_kinetics import HIGH, LOW, SHARE, entry, row_of
from pzt_ros.physics.front_tables import LOWER, TRIANGLE, UPPER
from pzt_ros.physics.signals import Array


class Fronts(NamedTuple):
    """The material as the loops want it.

    Attributes:
        table: see front_kinetics.front_table.
        shares: see front_tables.Everett.values.
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


@njit(cache=True, inline="always", error_model="numpy")
def _weights(t, t2, t3):  # type: ignore[no-untyped-def]
    """Cubic Hermite: of both values and of both slopes, from the place in the cell, its square and its cube."""
    value, slope = 3.0 * t2 - 2.0 * t3, t3 - t2
    return 1.0 - value, value, slope - t2 + t, slope


@njit(cache=True, inline="always", error_model="numpy")
def _locate(t, last):  # type: ignore[no-untyped-def]
    """Cell of a position in grid steps, and how far into it."""
    t = min(max(t, 0.0), last)
    k = min(int(t), int(last) - 1)
    return k, t - k


@njit(cache=True, inline="always", error_model="numpy")
def _contract(f, share, i, j, a, b):  # type: ignore[no-untyped-def]
    """Bicubic Hermite sum over a cell with the weights of u (a) and l (b)."""
    i, j = np.uint64(i), np.uint64(j)  # Numba spares the test for negative indices
    k, m = i + np.uint64(1), j + np.uint64(1)
    b0, b1, b2, b3 = b
    return (
        a[0] * (b0 * f[share, i, j, 0] + b1 * f[share, i, m, 0] + b2 * f[share, i, j, 2] + b3 * f[share, i, m, 2])
        + a[1] * (b0 * f[share, k, j, 0] + b1 * f[share, k, m, 0] + b2 * f[share, k, j, 2] + b3 * f[share, k, m, 2])
        + a[2] * (b0 * f[share, i, j, 1] + b1 * f[share, i, m, 1] + b2 * f[share, i, j, 3] + b3 * f[share, i, m, 3])
        + a[3] * (b0 * f[share, k, j, 1] + b1 * f[share, k, m, 1] + b2 * f[share, k, j, 3] + b3 * f[share, k, m, 3])
    )


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _hard(f, share, u, l):  # type: ignore[no-untyped-def]
    """A share for hard fronts at u and l [grid steps]."""
    if u <= l:
        return 0.0
    last = f.shape[1] - 1.0
    i, s = _locate(u, last)
    j, t = _locate(l, last)
    return _contract(f, share, i, j, _weights(s, s * s, s * s * s), _weights(t, t * t, t * t * t))


@njit(cache=True, inline="always", error_model="numpy")
def _mixed(w, s, t):  # type: ignore[no-untyped-def]
    """Mean weights of two places in one cell."""
    s2, t2 = s * s, t * t
    s3, t3 = s2 * s, t2 * t
    return _weights(t + w * (s - t), t2 + w * (s2 - t2), t3 + w * (s3 - t3))


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _mean(f, share, u1, u2, w, l1, l2, v):  # type: ignore[no-untyped-def]
    """Mean of four pairs of hard fronts: u1 has the weight w and u2 the rest, l1 v and l2 the rest [grid steps].

    Mostly both u and both l lie in a cell; one sum over it then does for all four.
    """
    if min(u1, u2) >= max(l1, l2) and min(l1, l2) >= 0.0 and max(u1, u2) < f.shape[1] - 1.0:
        i, j = int(u1), int(l1)
        s, t = u2 - i, l2 - j
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            return _contract(f, share, i, j, _mixed(w, u1 - i, s), _mixed(v, l1 - j, t))
    return _mean_far(f, share, u1, u2, w, l1, l2, v)


@njit(cache=True, error_model="numpy")
def _mean_far(f, share, u1, u2, w, l1, l2, v):  # type: ignore[no-untyped-def]
    """The same wherever they lie."""
    if max(u1, u2) <= min(l1, l2):
        return 0.0
    first = v * _hard(f, share, u1, l1) + (1.0 - v) * _hard(f, share, u1, l2)
    second = v * _hard(f, share, u2, l1) + (1.0 - v) * _hard(f, share, u2, l2)
    return w * first + (1.0 - w) * second


@njit(cache=True, inline="always", error_model="numpy")
def places(table, lead):  # type: ignore[no-untyped-def]
    """Where the two sub-fronts of a front are relative to it, and the share of the first."""
    k, t = row_of(table, lead)
    return entry(table, k, t, LOW), entry(table, k, t, HIGH), entry(table, k, t, SHARE)


@njit(cache=True, inline="always", error_model="numpy")
def everett(shares, per, s, u, profile, l, profile_l):  # type: ignore[no-untyped-def]
    """T of fronts with profiles [-]."""
    u1, u2, w = profile
    l1, l2, v = profile_l
    middle = 0.5 * (shares.shape[1] - 1)
    u1, u2, l1, l2 = (u + u1) * per, (u + u2) * per, (l1 - l) * per, (l2 - l) * per
    if s < 0.0:
        u1, u2, w, l1, l2, v = l1, l2, v, u1, u2, w
    return _mean(shares, TRIANGLE, middle + u1, middle + u2, w, middle - l1, middle - l2, v)


@njit(cache=True, inline="always", error_model="numpy")
def equilibrium(shares, per, s, u, profile, field):  # type: ignore[no-untyped-def]
    """Share of the domains between a front and its mirror image at the field that are down: the far half [-].

    This and the same for the mirrored front add up to T: the two fronts may change roles without a jump.
    """
    u1, u2, w = profile
    u1, u2 = (u - field + u1) * per, (u - field + u2) * per
    at = 0.5 * (shares.shape[1] - 1) + s * field * per
    return _mean(shares, LOWER if s > 0.0 else UPPER, at + u1, at + u2, w, at - u1, at - u2, w)


@njit(cache=True, error_model="numpy")
def _virgin(f, per, s, u, l):  # type: ignore[no-untyped-def]
    """Turned x - initial of hard fronts in a virgin specimen: first down to l, then up to u."""
    middle = 0.5 * (f.shape[1] - 1)
    up, down = (LOWER, UPPER) if s > 0.0 else (UPPER, LOWER)
    if u > -l:
        return _hard(f, up, middle + u * per, middle - u * per)
    before = _hard(f, down, middle - l * per, middle + l * per)
    if s < 0.0:
        u, l = -l, -u
    return _hard(f, TRIANGLE, middle + u * per, middle + l * per) - before


@njit(cache=True, error_model="numpy")
def leg(fr, k, s, u, lead, l, lead_l):  # type: ignore[no-untyped-def]
    """What the way from turning point k - 1 (at l) to k (at u) adds to x, in turned positions."""
    table, f, per = fr.table, fr.shares, fr.per
    profile, profile_l = places(table, lead), places(table, lead_l)
    if k > 1:
        return s * everett(f, per, s, u, profile, l, profile_l)
    u1, u2, w = u + profile[0], u + profile[1], profile[2]
    l1, l2, v = profile_l[0] - l, profile_l[1] - l, profile_l[2]
    middle = 0.5 * (f.shape[1] - 1)
    if min(u1, u2) > max(l1, l2):  # beyond all that was: the virgin half
        half, at1, at2 = UPPER if s < 0.0 else LOWER, u1 * per, u2 * per
        x = w * _hard(f, half, middle + at1, middle - at1) + (1.0 - w) * _hard(f, half, middle + at2, middle - at2)
        return s * x
    first = v * _virgin(f, per, s, u1, -l1) + (1.0 - v) * _virgin(f, per, s, u1, -l2)
    second = v * _virgin(f, per, s, u2, -l1) + (1.0 - v) * _virgin(f, per, s, u2, -l2)
    return s * (w * first + (1.0 - w) * second)
