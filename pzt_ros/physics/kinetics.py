"""Thermally activated switching: how often a domain crosses its barrier.

The Boltzmann ratios of thesis (3.9, 3.10) have the closed form 1/(tau erfcx(z)), z = (barrier left to climb)/d, with the
thermal field width d = sqrt(2 E1 k T / V_D). Everything below is compiled and branch-light, because it runs once per domain
and sample; erfcx is evaluated as methods.md 1.1 says: a polynomial in (a - c)/(a + c) over 1 + 2a.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev, polynomial
from scipy import special

from pzt_ros.quantities import BOLTZMANN

_CENTRE = 3.75
_DEGREE = 25


def _erfcx_coefficients() -> tuple[float, ...]:
    """Coefficients in y = (a - c)/(a + c) of (1 + 2a) erfcx(a), a >= 0, lowest order first."""

    def scaled(y: np.ndarray) -> np.ndarray:
        a = _CENTRE * (1 + y) / np.maximum(1 - y, 1e-300)
        return np.where(y < 1, (1 + 2 * a) * special.erfcx(a), 2 / math.sqrt(math.pi))

    fitted = chebyshev.chebinterpolate(scaled, _DEGREE)
    return tuple(float(c) for c in polynomial.polytrim(chebyshev.cheb2poly(fitted)))


_C = _erfcx_coefficients()


@njit(cache=True, inline="always")
def erfcx_positive(a: float) -> float:
    """exp(a^2) erfc(a) for a >= 0 [-]; relative error below 1e-14."""
    y = (a - _CENTRE) / (a + _CENTRE)
    y2 = y * y
    even = _C[24]
    odd = _C[25]
    even = even * y2 + _C[22]
    odd = odd * y2 + _C[23]
    even = even * y2 + _C[20]
    odd = odd * y2 + _C[21]
    even = even * y2 + _C[18]
    odd = odd * y2 + _C[19]
    even = even * y2 + _C[16]
    odd = odd * y2 + _C[17]
    even = even * y2 + _C[14]
    odd = odd * y2 + _C[15]
    even = even * y2 + _C[12]
    odd = odd * y2 + _C[13]
    even = even * y2 + _C[10]
    odd = odd * y2 + _C[11]
    even = even * y2 + _C[8]
    odd = odd * y2 + _C[9]
    even = even * y2 + _C[6]
    odd = odd * y2 + _C[7]
    even = even * y2 + _C[4]
    odd = odd * y2 + _C[5]
    even = even * y2 + _C[2]
    odd = odd * y2 + _C[3]
    even = even * y2 + _C[0]
    odd = odd * y2 + _C[1]
    return (even + y * odd) / (1.0 + 2.0 * a)


@njit(cache=True, inline="always")
def switching_rate(z: float) -> float:
    """1/erfcx(z) [-], for any z: 0 below about -27, sqrt(pi) z for large z (3.9, 3.10)."""
    a = abs(z)
    g = erfcx_positive(a)
    if z >= 0.0:
        return 1.0 / g
    e = math.exp(-a * a)
    return e / (2.0 - e * g)


def thermal_width(reciprocal_permittivity: float, temperature: float, domain_volume: float) -> float:
    """Thermal field width d = sqrt(2 E1 k T / V_D) [V/m] from E1 [V m/C], T [K], V_D [m^3]."""
    return math.sqrt(2.0 * reciprocal_permittivity * BOLTZMANN * temperature / domain_volume)
