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

import numpy as np
from numba import njit
from scipy import special

from pzt_ros.physics.kinetics import erfcx_positive, exponential, switching_rate
from pzt_ros.physics.signals import Array

HALF = math.log(2.0)
_PER_HALF = 1.0 / HALF
_ROOT_PI = math.sqrt(math.pi)

_FIRST, _LAST = -12.0, 40.0
_PER_UNIT = 32
LOW, HIGH, SHARE, REACH, RATE, RISE, LOG, SLOPE, STEEPEN, COLUMNS = range(10)
"""Columns of the table over z, see `front_table`."""

_NO_ATTEMPTS = 1e-12  # of a piece: the front does not move
_SMALL = 0.1  # relative attempts of a piece for which an expansion to third order will do
_SHORT = 0.1  # climb of the field for which the rate is a parabola
_LONG = 0.3  # climb for which Gauss' rule of three nodes will do
_GAUSS = math.sqrt(0.15)
_APART = 1e-8  # relative attempts of a front at another that do not count any more


def front_table() -> Array:
    """What depends on one z, for z = -12, -12 + 1/32, ... 40; shape (n, 8).

    RATE, RISE: p and p'/32; LOG: ln Phi; SLOPE: p/Phi, its derivative; STEEPEN: 1 over the derivative of that.
    LOW, HIGH, SHARE: a front with lead z stands for two hard ones, at u + LOW (this share of it) and u + HIGH. They are
    the Gauss rule for the distribution of hard fronts 1 - exp(-H): mean, width and skewness are right.
    REACH: how far ahead of u a front of lead z has made attempts that count.
    """
    z = np.arange(_FIRST, _LAST + 0.5 / _PER_UNIT, 1 / _PER_UNIT)
    fine = np.arange(-20.0, 400.0, 1 / 128)
    log_fine = np.log(_attempts_of(fine))
    log_attempts = np.log(_attempts_of(z))
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
    table = np.zeros((z.size, COLUMNS))
    table[:, LOW] = mean + sigma * (skew / 2 - root)
    table[:, HIGH] = mean + sigma * (skew / 2 + root)
    table[:, SHARE] = 0.5 * (1 + skew / 2 / root)
    table[:, REACH] = z - np.interp(log_attempts + math.log(_APART), log_fine, fine)
    table[:, RATE] = rate
    table[:, RISE] = rate * (2 / _ROOT_PI * rate - 2 * z) / _PER_UNIT
    table[:, LOG] = log_attempts
    table[:, SLOPE] = rate / np.exp(log_attempts)
    table[:, STEEPEN] = 1.0 / (table[:, SLOPE] * (2 / _ROOT_PI * rate - 2 * z - table[:, SLOPE]))
    return table


def _attempts_of(z: Array) -> Array:
    high = math.log(2.0) + z**2 - np.log(special.erfcx(np.maximum(z, 0.0)))
    low = -np.log1p(-special.erfc(np.maximum(-z, 0.0)) / 2)
    return _ROOT_PI / 2 * np.where(z > 0, high, low)


@njit(cache=True, error_model="numpy")
def attempts(z):  # type: ignore[no-untyped-def]
    """Phi(z) [-]."""
    if z >= 0.0:
        return _ROOT_PI / 2 * (HALF + z * z - math.log(erfcx_positive(z)))
    return -_ROOT_PI / 2 * math.log1p(-0.5 * exponential(-z * z) * erfcx_positive(-z))


@njit(cache=True, error_model="numpy")
def _exact_rate(z):  # type: ignore[no-untyped-def]
    """p(z), compiled once."""
    return switching_rate(z)


@njit(cache=True, inline="always", error_model="numpy")
def row_of(table, z):  # type: ignore[no-untyped-def]
    """Where z lies in the table: row and fraction of the way to the next."""
    s = min(max((z - _FIRST) * _PER_UNIT, 0.0), table.shape[0] - 1.000001)
    k = int(s)
    return k, s - k


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract"})
def entry(table, k, t, column):  # type: ignore[no-untyped-def]
    """An entry of the table, linear between rows."""
    return table[k, column] + t * (table[k + 1, column] - table[k, column])


@njit(cache=True, inline="always", error_model="numpy", fastmath={"contract"})
def _smooth(y0, y1, m0, m1, t):  # type: ignore[no-untyped-def]
    """Cubic Hermite between values y with slopes m (times 1/32)."""
    e = y1 - y0
    return y0 + t * (m0 + t * (3.0 * e - 2.0 * m0 - m1 + t * (m0 + m1 - 2.0 * e)))


@njit(cache=True, inline="always", error_model="numpy")
def _rate(table, z):  # type: ignore[no-untyped-def]
    """p(z) from the table, to 1e-5; its slope is p (2 p/sqrt(pi) - 2 z)."""
    if z >= _LAST:
        return _exact_rate(z)
    k, t = row_of(table, z)
    return _smooth(table[k, RATE], table[k + 1, RATE], table[k, RISE], table[k + 1, RISE], t)


@njit(cache=True, error_model="numpy")
def _log_attempts(table, z):  # type: ignore[no-untyped-def]
    """ln Phi(z) from the table."""
    if z >= _LAST:
        return math.log(attempts(z))
    k, t = row_of(table, z)
    slope0, slope1 = table[k, SLOPE] / _PER_UNIT, table[k + 1, SLOPE] / _PER_UNIT
    return _smooth(table[k, LOG], table[k + 1, LOG], slope0, slope1, t)


@njit(cache=True, error_model="numpy")
def _lead_of(table, slope, guess):  # type: ignore[no-untyped-def]
    """The lead z with p(z)/Phi(z) = slope, by Newton steps on the logarithms."""
    z = guess
    for _ in range(20):
        k, t = row_of(table, z)
        own = entry(table, k, t, SLOPE)
        change = math.log(own / slope) / (own - (2.0 / _ROOT_PI * entry(table, k, t, RATE) - 2.0 * z))
        z = min(max(z + change, _FIRST), _LAST)
        if abs(change) < 1e-4:
            break
    return z


@njit(cache=True, inline="always", error_model="numpy")
def _short_piece(table, z, climb, duration):  # type: ignore[no-untyped-def]
    """As `_piece`, with z at mid-climb, for a climb so short that the rate is a parabola."""
    p = _rate(table, z)
    bend = 2.0 / _ROOT_PI * p - 2.0 * z  # p'/p; then p''/p
    bend2 = bend * (4.0 / _ROOT_PI * p - 2.0 * z) - 2.0
    H = duration * p * (1.0 + bend2 * climb * climb / 24.0)
    return H, H * bend, H * bend2


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _piece(table, a, start, end, duration):  # type: ignore[no-untyped-def]
    """Attempts at the threshold a during a linear piece of field, and minus their first and second slope over a."""
    climb = end - start
    z = 0.5 * (start + end) - a
    if abs(climb) < _SHORT:
        return _short_piece(table, z, climb, duration)
    if abs(climb) < _LONG:
        H, H1, H2 = 0.0, 0.0, 0.0
        for node in range(3):  # Gauss' rule
            y = z + (node - 1) * _GAUSS * climb
            p = _rate(table, y)
            bend = 2.0 / _ROOT_PI * p - 2.0 * y
            share = duration * p * (4.0 / 9.0 if node == 1 else 5.0 / 18.0)
            H += share
            H1 += share * bend
            H2 += share * (bend * (4.0 / _ROOT_PI * p - 2.0 * y) - 2.0)
        return H, H1, H2
    z0, z1 = start - a, end - a
    p0, p1 = _exact_rate(z0), _exact_rate(z1)
    bend0, bend1 = p0 * (2.0 / _ROOT_PI * p0 - 2.0 * z0), p1 * (2.0 / _ROOT_PI * p1 - 2.0 * z1)
    scale = duration / climb
    return scale * (attempts(z1) - attempts(z0)), scale * (p1 - p0), scale * (bend1 - bend0)


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def move(table, u, lead, start, end, duration):  # type: ignore[no-untyped-def]
    """Position and lead of a front that moves up, after a linear piece of field."""
    climb = end - start
    if abs(climb) < _SHORT:
        more, fall, fall2 = _short_piece(table, 0.5 * (start + end) - u, climb, duration * _PER_HALF)
    else:
        more, fall, fall2 = _piece(table, u, start, end, duration * _PER_HALF)
    if more < _NO_ATTEMPTS:
        return u, lead
    if more > _SMALL:
        return _move_far(table, u, lead, start, end, duration, more, fall)
    k, t = row_of(table, lead)
    slope = entry(table, k, t, SLOPE)
    own = 2.0 / _ROOT_PI * entry(table, k, t, RATE) - 2.0 * lead  # p'/p at the lead; then p''/p
    own2 = own * (2.0 * own + 2.0 * lead) - 2.0
    # attempts at u + y, in terms of those at u: 1 + more - first y + second y^2/2 - third y^3/6 = 1
    first, second, third = slope + fall, slope * own + fall2, slope * own2
    inverse = 1.0 / first
    y = more * inverse
    a, b = 0.5 * second * inverse, third * inverse / 6.0
    y *= 1.0 + y * (a + y * (2.0 * a * a - b))  # series reversion
    change = fall - y * (second - 0.5 * y * third)
    return u + y, lead + change * entry(table, k, t, STEEPEN)


@njit(cache=True, error_model="numpy")
def _move_far(table, u, lead, start, end, duration, more, fall):  # type: ignore[no-untyped-def]
    """The same by Newton's method on ln H, for pieces that move the front by much of its width or more."""
    own = _log_attempts(table, lead)
    low, high = u, max(u, start, end) + 12.0
    k, t = row_of(table, lead)
    a, H, S = u, 1.0 + more, entry(table, k, t, SLOPE) + fall
    for _ in range(80):
        ahead = math.log(H) * H / S
        if ahead > 0.0:
            low = a
        else:
            high = a
        a += ahead
        if abs(ahead) < 1e-7:
            break
        if not low < a < high:
            a = 0.5 * (low + high)
        more, fall, _ = _piece(table, a, start, end, duration)
        z = lead - (a - u)
        old = exponential(_log_attempts(table, z) - own)
        k, t = row_of(table, z)
        H = max(more / HALF + old, 1e-290)
        S = max(fall / HALF + old * entry(table, k, t, SLOPE), 1e-290)
    guess = lead if abs(a - u) < 1.0 else 2.0 / S - 0.5 * S
    return a, _lead_of(table, S, min(max(guess, _FIRST), _LAST))


@njit(cache=True, error_model="numpy")
def relative_attempts(table, u, lead, a):  # type: ignore[no-untyped-def]
    """H(a) of a front over that at its own position."""
    return exponential(_log_attempts(table, lead - (a - u)) - _log_attempts(table, lead))


@njit(cache=True, error_model="numpy")
def merge(table, u, lead, v, lead_v):  # type: ignore[no-untyped-def]
    """The front of domains that have seen the attempts of both: position and lead.

    It is what makes loops close softly: where a front comes back to where it turned, domains just beyond have had half
    of their attempts already. A hard maximum of both is 0.2 to 0.8 d short there.
    """
    own, other = _log_attempts(table, lead), _log_attempts(table, lead_v)
    a = max(u, v)
    slope = 0.0
    for _ in range(30):
        y, w = lead - (a - u), lead_v - (a - v)
        H = exponential(_log_attempts(table, y) - own)
        H_v = exponential(_log_attempts(table, w) - other)
        if H < _APART:
            return v, lead_v
        if H_v < _APART:
            return u, lead
        k, t = row_of(table, y)
        slope = H * entry(table, k, t, SLOPE)
        k, t = row_of(table, w)
        slope += H_v * entry(table, k, t, SLOPE)
        ahead = math.log(H + H_v) * (H + H_v) / slope
        a += ahead
        if abs(ahead) < 1e-4:  # Newton's next would be below 1e-8
            break
    return a, _lead_of(table, slope, lead if u > v else lead_v)
