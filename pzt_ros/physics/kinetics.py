"""Thermally activated switching: how often a domain crosses its barrier.

The Boltzmann ratios of thesis (3.9, 3.10) have the closed form 1/(tau erfcx(z)), z = (field beyond the barrier)/d, with
the thermal field width d = sqrt(2 E1 k T / V_D). Everything below is compiled, and free of branches so that a loop over
it becomes SIMD, because it runs once per domain and sample; erfcx is evaluated as methods.md 1.1 says: a polynomial in
(a - c)/(a + c) over 1 + 2a.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev, polynomial
from scipy import special

from pzt_ros.quantities import BOLTZMANN

_CENTRE = 3.75
_DEGREE = 25

_LOG2_E = 1.0 / math.log(2.0)
_LN2_HIGH = 0.693147180369123816490  # the sum of both is ln 2 to 85 bits
_LN2_LOW = 1.90821492927058770002e-10


def _erfcx_coefficients() -> tuple[float, ...]:
    """Coefficients in y = (a - c)/(a + c) of (1 + 2a) erfcx(a), a >= 0, lowest order first."""

    def scaled(y: np.ndarray) -> np.ndarray:
        a = _CENTRE * (1 + y) / np.maximum(1 - y, 1e-300)
        return np.where(y < 1, (1 + 2 * a) * special.erfcx(a), 2 / math.sqrt(math.pi))

    fitted: Any = chebyshev.chebinterpolate(cast(Any, scaled), _DEGREE)  # the stubs know it for scalars only
    return tuple(float(c) for c in polynomial.polytrim(chebyshev.cheb2poly(fitted)))


_C = _erfcx_coefficients()


@njit(cache=True, inline="always", error_model="numpy")
def exponential(x: float) -> float:
    """exp(x) for x <= 700 [-], relative error below 1e-15; 0 below -700.

    Numba calls the exp of libm one value at a time; a loop over this one becomes SIMD, 5 times as fast. Reduction to
    |r| <= ln(2)/2, Taylor polynomial, and the power of two put straight into the exponent's bits.
    """
    bounded = max(x, -700.0)
    k = math.floor(bounded * _LOG2_E + 0.5)
    r = (bounded - k * _LN2_HIGH) - k * _LN2_LOW
    r2 = r * r
    even = 1.0 + r2 * (1 / 2 + r2 * (1 / 24 + r2 * (1 / 720 + r2 * (1 / 40320 + r2 * (1 / 3628800 + r2 / 479001600)))))
    odd = 1.0 + r2 * (
        1 / 6 + r2 * (1 / 120 + r2 * (1 / 5040 + r2 * (1 / 362880 + r2 * (1 / 39916800 + r2 / 6227020800))))
    )
    power = np.int64((np.int64(k) + 1023) << 52).view(np.float64)
    return (even + r * odd) * power if x >= -700.0 else 0.0


@njit(cache=True, inline="always", error_model="numpy")
def _scaled_erfcx(a: float) -> float:
    """(1 + 2a) erfcx(a) for a >= 0 [-]."""
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
    return even + y * odd


@njit(cache=True, inline="always", error_model="numpy")
def erfcx_positive(a: float) -> float:
    """exp(a^2) erfc(a) for a >= 0 [-]; relative error below 1e-14."""
    return _scaled_erfcx(a) / (1.0 + 2.0 * a)


@njit(cache=True, inline="always", error_model="numpy")
def switching_rate(z: float) -> float:
    """1/erfcx(z) [-], for any z: 0 below about -26.4, sqrt(pi) z for large z (3.9, 3.10).

    erfcx(-a) = 2 exp(a^2) - erfcx(a), times exp(-a^2) so that nothing overflows, times 1 + 2a to save divisions.
    """
    a = abs(z)
    scale = 1.0 + 2.0 * a
    scaled = _scaled_erfcx(a)
    e = exponential(-a * a)
    return scale / scaled if z >= 0.0 else e * scale / (2.0 * scale - e * scaled)


def thermal_width(reciprocal_permittivity: float, temperature: float, domain_volume: float) -> float:
    """Thermal field width d = sqrt(2 E1 k T / V_D) [V/m] from E1 [V m/C], T [K], V_D [m^3]."""
    return math.sqrt(2.0 * reciprocal_permittivity * BOLTZMANN * temperature / domain_volume)
