"""How a switching front moves: the two numbers that describe it, and their exact step.

Domains with threshold a see the field E(t) and switch at the rate p((E - a)/d)/tau, p(z) = 1/erfcx(z). What counts is
the expected number of attempts H(a, t) = int p dt/tau: a share 1 - exp(-H) has switched. In a ramp of rate R from
below H = (d/(R tau)) Phi((E - a)/d), with

    Phi(z) = int_-inf^z dz'/erfcx(z') = sqrt(pi)/2 ln(2/erfc(z)),

a closed form. The front keeps two numbers of the profile H(a): the position u where H = ln 2 (half of the domains have
switched) and the lead z for which the profile is that of a ramp, H(a) = ln 2 Phi(z - (a - u)/d)/Phi(z). From them it
moves on over a linear piece of field of any length: the attempts of the piece are added exactly, the new u is where the
sum is ln 2, and the new z is that of its slope there. So ramps of any rate, their reversals and long holds come out
right in one step each; there is no stiff ODE to integrate. (methods.md closes with one number, u.)

All lengths here are in units of the thermal width d, times in units of tau.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy import special

from pzt_ros.physics.kinetics import exponential
from pzt_ros.physics.signals import Array

HALF = math.log(2.0)
PER_HALF = 1.0 / HALF
_ROOT_PI = math.sqrt(math.pi)

FIRST, LAST = -12.0, 40.0
PER_UNIT = 32
LOW, HIGH, SHARE, REACH, SLOPE, BEND, CURVE, STEEPEN, RATE, ATTEMPTS, LOG, LEAD, COLUMNS = map(
    np.int64, (*range(9), 12, 16, 20, 24)
)
"""Columns of the table over z, see `front_table`; four each of RATE, ATTEMPTS, LOG and LEAD.

Numba compiles a function anew for each plain integer that it is called with, but not for these.
"""

_WITHIN: dict[str, Any] = {
    "cache": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "_nrt": False,  # references to arrays handed on are not counted: a third of the time; nothing inside allocates
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}

inner = njit(**_WITHIN)
"""For functions that only compiled ones call; without wrappers for Python they compile a fifth faster.

Python must not call them: that ends in a segmentation fault. Wrap one in an `njit` function to try it out.
"""

inlined = njit(**_WITHIN, forceinline=True)
"""The same for look-ups of a few operations."""

unfolded = njit(**_WITHIN, inline="always")
"""The same for what is called in one place: it is compiled there only."""

NO_ATTEMPTS = 1e-12  # of a piece: the front does not move
SMALL = 0.1  # relative attempts of a piece for which an expansion to third order will do
SHORT = 0.1  # climb of the field for which the rate is a parabola
_NEAR = 2e-3  # [d]; a step of Halley's after which the next would be below 1e-8
_APART = 1e-8  # relative attempts of a front at another that do not count any more


def front_table() -> Array:
    """What depends on one z, for z = -12, -12 + 1/32, ... 40; shape (n, 24).

    RATE, ATTEMPTS, LOG: p, Phi and ln Phi, as the coefficients of a cubic in the fraction of the way to the next row.
    SLOPE, BEND, CURVE: p, p' and p'' over Phi; STEEPEN: 1 over the derivative of SLOPE. LEAD: the z of which the slope
    is S, a cubic too, but in the rows of 2/S - S/2, which is nearly z.
    LOW, HIGH, SHARE: a front with lead z stands for two hard ones, at u + LOW (this share of it) and u + HIGH. They are
    the Gauss rule for the distribution of hard fronts 1 - exp(-H): mean, width and skewness are right.
    REACH: how far ahead of u a front of lead z has made attempts that count.
    """
    z = np.arange(FIRST, LAST + 0.5 / PER_UNIT, 1 / PER_UNIT)
    fine = np.arange(-20.0, 400.0, 1 / 128)
    log_fine = np.log(attempts(fine))
    log_attempts = np.log(attempts(z))
    # H = exp(t) at the quantiles of the front is exponentially distributed
    t = np.linspace(-42.0, 4.0, 1500)
    weight = np.exp(t - np.exp(t))
    weight /= weight.sum()
    place = z[:, None] - np.interp(log_attempts[:, None] + t - math.log(HALF), log_fine, fine)
    mean = place @ weight
    deviation = place - mean[:, None]
    sigma = np.sqrt(deviation**2 @ weight)
    skew = (deviation**3 @ weight) / sigma**3
    root = np.sqrt(1 + skew**2 / 4)
    rate = 1 / special.erfcx(z)
    growth = 2 / _ROOT_PI * rate - 2 * z  # p'/p; then p''/p
    growth2 = growth * (4 / _ROOT_PI * rate - 2 * z) - 2
    table = np.zeros((z.size, COLUMNS))
    table[:, LOW] = mean + sigma * (skew / 2 - root)
    table[:, HIGH] = mean + sigma * (skew / 2 + root)
    table[:, SHARE] = 0.5 * (1 + skew / 2 / root)
    table[:, REACH] = z - np.interp(log_attempts + math.log(_APART), log_fine, fine)
    slope = rate / np.exp(log_attempts)
    table[:, SLOPE], table[:, BEND], table[:, CURVE] = slope, slope * growth, slope * growth2
    table[:, STEEPEN] = 1 / (slope * (growth - slope))
    table[:, RATE : RATE + 4] = _cubics(rate, rate * growth / PER_UNIT)
    table[:, ATTEMPTS : ATTEMPTS + 4] = _cubics(np.exp(log_attempts), rate / PER_UNIT)
    table[:, LOG : LOG + 4] = _cubics(log_attempts, slope / PER_UNIT)
    lead = z.copy()
    for _ in range(20):  # Newton
        rate = 1 / special.erfcx(lead)
        slope = rate / attempts(lead)
        per_lead = slope * (slope - 2 / _ROOT_PI * rate + 2 * lead) * (2 / slope**2 + 0.5)
        lead += (z - 2 / slope + slope / 2) / per_lead
    table[:, LEAD : LEAD + 4] = _cubics(lead, 1 / per_lead / PER_UNIT)
    return table


def _cubics(value: Array, change: Array) -> Array:
    """Coefficients of the Hermite cubics between neighbouring rows, from values and their change per row."""
    step = np.diff(value, append=value[-1])
    after = np.append(change[1:], 0.0)
    return np.stack((value, change, 3 * step - 2 * change - after, change + after - 2 * step), axis=1)


def attempts(z: Array) -> Array:
    """Phi(z) [-]."""
    high = math.log(2.0) + z**2 - np.log(special.erfcx(np.maximum(z, 0.0)))
    low = -np.log1p(-special.erfc(np.maximum(-z, 0.0)) / 2)
    return _ROOT_PI / 2 * np.where(z > 0, high, low)


@inlined
def row_of(table, z):  # type: ignore[no-untyped-def]
    """Where z lies in the table: row and fraction of the way to the next."""
    s = min(max((z - FIRST) * PER_UNIT, 0.0), table.shape[0] - 1.000001)
    k = int(s)
    return np.uint64(k), s - k  # Numba spares the test for negative indices


@inlined
def entry(table, k, t, column):  # type: ignore[no-untyped-def]
    """An entry of the table, linear between rows."""
    return table[k, column] + t * (table[k + np.uint64(1), column] - table[k, column])


class Rates(NamedTuple):
    """A row of the table for p: where it begins, and its cubic in rows from there."""

    begin: float
    p0: float
    p1: float
    p2: float
    p3: float


class Slopes(NamedTuple):
    """A row of the table for a front: where it begins, what it has there, the changes to the next, REACH at most."""

    begin: float
    slope: float
    bend: float
    curve: float
    steepen: float
    slope_change: float
    bend_change: float
    curve_change: float
    steepen_change: float
    reach: float


@inlined
def rates_at(table, z):  # type: ignore[no-untyped-def]
    """The row for p around z, for z below LAST."""
    row = int(max((z - FIRST) * PER_UNIT, 0.0))
    k = np.uint64(row)
    return Rates(FIRST + row / PER_UNIT, table[k, RATE], table[k, RATE + 1], table[k, RATE + 2], table[k, RATE + 3])


@inlined
def slopes_at(table, lead):  # type: ignore[no-untyped-def]
    """The row for a front around its lead."""
    k, _ = row_of(table, lead)
    m = k + np.uint64(1)
    a, b, c, d = table[k, SLOPE], table[k, BEND], table[k, CURVE], table[k, STEEPEN]
    more, further, still, last = table[m, SLOPE] - a, table[m, BEND] - b, table[m, CURVE] - c, table[m, STEEPEN] - d
    return Slopes(FIRST + k / PER_UNIT, a, b, c, d, more, further, still, last, table[m, REACH])


@inlined
def rate_in(row, z):  # type: ignore[no-untyped-def]
    """p(z) from its row."""
    t = (z - row.begin) * PER_UNIT
    return row.p0 + t * (row.p1 + t * (row.p2 + t * row.p3))


@inlined
def _rate(table, z):  # type: ignore[no-untyped-def]
    """p(z) from the table, to 1e-5; its slope is p (2 p/sqrt(pi) - 2 z)."""
    return _ROOT_PI * (z + 0.5 / z) if z >= LAST else rate_in(rates_at(table, z), z)  # asymptotic, to 2e-7


@inner
def _log_attempts(table, z):  # type: ignore[no-untyped-def]
    """ln Phi(z) from the table."""
    if z >= LAST:
        return math.log(_ROOT_PI / 2 * (math.log(2.0 * _ROOT_PI * z) + z * z))
    k, t = row_of(table, z)
    return table[k, LOG] + t * (table[k, LOG + 1] + t * (table[k, LOG + 2] + t * table[k, LOG + 3]))


@inlined
def _attempts(table, z):  # type: ignore[no-untyped-def]
    """Phi(z) from the table, to some 1e-5 of it, with its first and second derivative."""
    k, t = row_of(table, z)
    H = table[k, ATTEMPTS] + t * (table[k, ATTEMPTS + 1] + t * (table[k, ATTEMPTS + 2] + t * table[k, ATTEMPTS + 3]))
    p = table[k, RATE] + t * (table[k, RATE + 1] + t * (table[k, RATE + 2] + t * table[k, RATE + 3]))
    return H, p, p * (2.0 / _ROOT_PI * p - 2.0 * z)


@inner
def _attempts_beyond(z):  # type: ignore[no-untyped-def]
    """The same for z of LAST and more: asymptotic, to 2e-7."""
    p = _ROOT_PI * (z + 0.5 / z)
    return _ROOT_PI / 2 * (math.log(2.0 * _ROOT_PI * z) + z * z), p, p * (2.0 / _ROOT_PI * p - 2.0 * z)


@inner
def _lead_of(table, slope):  # type: ignore[no-untyped-def]
    """The lead z with p(z)/Phi(z) = slope."""
    k, t = row_of(table, 2.0 / slope - 0.5 * slope)
    z = table[k, LEAD] + t * (table[k, LEAD + 1] + t * (table[k, LEAD + 2] + t * table[k, LEAD + 3]))
    return min(max(z, FIRST), LAST)


@inlined
def short_piece(p, z, climb, duration):  # type: ignore[no-untyped-def]
    """As `_piece`, with z and p(z) at mid-climb, for a climb so short that the rate is a parabola."""
    growth = 2.0 / _ROOT_PI * p - 2.0 * z  # p'/p; then p''/p
    growth2 = growth * (4.0 / _ROOT_PI * p - 2.0 * z) - 2.0
    H = duration * p
    H += H * growth2 * (climb * climb * (1.0 / 24.0))
    return H, H * growth, H * growth2


@inlined
def short_move(row, lead, more, fall, fall2):  # type: ignore[no-untyped-def]
    """How far a front moves and how its lead changes [both d] by few attempts.

    `more`, `fall` and `fall2`: attempts and minus their first and second slope at the front, as `short_piece` has them,
    over the ln 2 that half of the domains need.
    """
    r = (lead - row.begin) * PER_UNIT
    # attempts at u + y, in terms of those at u: 1 + more - first y + second y^2/2 - third y^3/6 = 1
    first = row.slope + r * row.slope_change + fall
    second, third = row.bend + r * row.bend_change + fall2, row.curve + r * row.curve_change
    inverse = 1.0 / first
    y, a, b = more * inverse, 0.5 * second * inverse, third * (1.0 / 6.0) * inverse
    y *= 1.0 + y * (a + y * (2.0 * a * a - b))  # series reversion
    change = fall - y * (second - 0.5 * y * third)
    return y, change * (row.steepen + r * row.steepen_change)


@inlined
def _piece(table, a, start, end, duration):  # type: ignore[no-untyped-def]
    """Attempts at the threshold a during a linear piece of field, and minus their first and second slope over a."""
    climb = end - start
    if abs(climb) < SHORT:
        z = 0.5 * (start + end) - a
        return short_piece(_rate(table, z), z, climb, duration)
    per_climb = duration / climb
    z, z_0 = end - a, start - a
    H, p, bend = _attempts_beyond(z) if z >= LAST else _attempts(table, z)
    H_0, p_0, bend_0 = _attempts_beyond(z_0) if z_0 >= LAST else _attempts(table, z_0)
    return per_climb * (H - H_0), per_climb * (p - p_0), per_climb * (bend - bend_0)


@inner
def move(table, u, lead, start, end, duration):  # type: ignore[no-untyped-def]
    """Position and lead of a front that moves up, after a linear piece of field."""
    relative = duration * PER_HALF
    more, fall, fall2 = _piece(table, u, start, end, relative)
    if more < NO_ATTEMPTS:
        return u, lead
    if more > SMALL:
        return _move_far(table, u, lead, start, end, relative, more, fall, fall2)
    ahead, change = short_move(slopes_at(table, lead), lead, more, fall, fall2)
    return u + ahead, lead + change


@inner
def _move_far(table, u, lead, start, end, relative, more, fall, fall2):  # type: ignore[no-untyped-def]
    """The same by steps to the zero of ln H, for pieces that move the front by much of its width or more."""
    H, slope, bend = _attempts(table, lead)
    share = 1.0 / H
    low, high = u, max(u, start, end) + 12.0
    a, H, slope, bend = u, 1.0 + more, slope * share + fall, bend * share + fall2
    for _ in range(80):
        log, square = math.log(H), slope * slope
        ahead = log * H / slope  # Newton's step; Halley's where that is near
        if abs(log) < 1.0:
            ahead *= square / max(square - 0.5 * log * (square - bend * H), 0.5 * square)
        if ahead > 0.0:
            low = a
        else:
            high = a
        a += ahead
        if abs(ahead) < _NEAR:
            slope -= bend * ahead
            break
        if not low < a < high:
            a = 0.5 * (low + high)
        more, fall, fall2 = _piece(table, a, start, end, relative)
        H, slope, bend = _attempts(table, lead - (a - u))
        H, slope, bend = max(more + H * share, 1e-290), max(fall + slope * share, 1e-290), fall2 + bend * share
    return a, _lead_of(table, slope)


@inner
def relative_attempts(table, u, lead, a):  # type: ignore[no-untyped-def]
    """H(a) of a front over that at its own position."""
    return exponential(_log_attempts(table, lead - (a - u)) - _log_attempts(table, lead))


@inner
def merge(table, u, lead, v, lead_v):  # type: ignore[no-untyped-def]
    """The front of domains that have seen the attempts of both: position and lead.

    It is what makes loops close softly: where a front comes back to where it turned, domains just beyond have had half
    of their attempts already. A hard maximum of both is 0.2 to 0.8 d short there.
    """
    share, share_v = 1.0 / _attempts(table, lead)[0], 1.0 / _attempts(table, lead_v)[0]
    a, slope = max(u, v), 0.0
    for _ in range(30):
        (H, p, bend), (H_v, p_v, bend_v) = _attempts(table, lead - (a - u)), _attempts(table, lead_v - (a - v))
        H, H_v = H * share, H_v * share_v
        if H < _APART:
            return v, lead_v
        if H_v < _APART:
            return u, lead
        both, slope, bend = H + H_v, p * share + p_v * share_v, bend * share + bend_v * share_v
        log = math.log(both)  # its zero by Halley's step
        ahead = log * both * slope / (slope * slope - 0.5 * log * (slope * slope - bend * both))
        a += ahead
        slope -= bend * ahead
        if abs(ahead) < _NEAR:
            break
    return a, _lead_of(table, slope)
