"""w with erfc(-w) = y, compiled: rational functions, no iteration (AS 241, Wichura 1988, PPND16)."""

from __future__ import annotations

import math

from numba import njit

_SQRT_HALF = math.sqrt(0.5)
LEAST = 1e-17
"""Of the domains; smaller shares are none (the physics' HARDEST)."""

# Wichura, Applied Statistics 37 (1988) 477, PPND16: relative accuracy about 1e-16; highest order first.
_A = (
    2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
    13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608,
)  # fmt: skip
_B = (
    5226.495278852854561, 28729.085735721942674, 39307.89580009271061, 21213.794301586595867,
    5394.1960214247511077, 687.1870074920579083, 42.313330701600911252, 1.0,
)  # fmt: skip
_C = (
    7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177, 1.27045825245236838258,
    3.64784832476320460504, 5.7694972214606914055, 4.6303378461565452959, 1.42343711074968357734,
)  # fmt: skip
_D = (
    1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966, 0.14810397642748007459,
    0.68976733498510000455, 1.6763848301838038494, 2.05319162663775882187, 1.0,
)  # fmt: skip
_E = (
    2.01033439929228813265e-7, 2.71155556874348757815e-5, 0.0012426609473880784386, 0.026532189526576123093,
    0.29656057182850489123, 1.7848265399172913358, 5.4637849111641143699, 6.6579046435011037772,
)  # fmt: skip
_F = (
    2.04426310338993978564e-15, 1.4215117583164458887e-7, 1.8463183175100546818e-5, 7.868691311456132591e-4,
    0.0148753612908506148525, 0.13692988092273580531, 0.59983220655588793769, 1.0,
)  # fmt: skip


@njit(cache=True, inline="always", error_model="numpy")
def _ratio(p: tuple[float, ...], q: tuple[float, ...], r: float) -> float:
    """Two polynomials of order 7, one over the other."""
    over = ((((((p[0] * r + p[1]) * r + p[2]) * r + p[3]) * r + p[4]) * r + p[5]) * r + p[6]) * r + p[7]
    under = ((((((q[0] * r + q[1]) * r + q[2]) * r + q[3]) * r + q[4]) * r + q[5]) * r + q[6]) * r + q[7]
    return over / under


@njit(cache=True, error_model="numpy")
def place(y: float) -> float:
    """w with erfc(-w) = y [-], 0 < y < 2; where y/2 or 1 - y/2 is below LEAST, that of LEAST."""
    q = 0.5 * y - 0.5
    if abs(q) <= 0.425:
        return _SQRT_HALF * q * _ratio(_A, _B, 0.180625 - q * q)
    tail = max(0.5 * min(y, 2.0 - y), LEAST)
    r = math.sqrt(-math.log(tail))
    w = _SQRT_HALF * (_ratio(_C, _D, r - 1.6) if r <= 5.0 else _ratio(_E, _F, r - 5.0))
    return w if q > 0.0 else -w
