"""How fast x+ changes: barriers that follow x+ along one branch, and the rates over them, compiled.

Every parametrized model is, along one branch, dx/dt = [r(z-+) (1 - x) - r(z+-) x]/tau with z-+ = (E - B-+)/d,
z+- = (B+- - E)/d and barriers B = centre + slope w, erfc(-w) = gain x + offset (thesis 3.22, 3.29, 3.34). So four
numbers for each direction say everything; solvers see no other difference between models, branches and memory.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from pzt_ros.optimal.inverse_erfc import place
from pzt_ros.physics.compiling import WITHIN
from pzt_ros.physics.kinetics import switching_rate
from pzt_ros.physics.signals import Array

NUMBERS: Final = 8
"""A barrier law as a row: centre [V/m], slope [V/m], gain, offset upwards; the same downwards."""

_TWO_BY_SQRT_PI = 2.0 / math.sqrt(math.pi)
_HALF_SQRT_PI = 0.5 * math.sqrt(math.pi)

compiled = njit(cache=True, error_model="numpy", nogil=True)


class Material(NamedTuple):
    """What does not change from branch to branch, SI."""

    thermal_width: float
    relaxation_time: float
    domain_polarization: float
    reciprocal_permittivity: float


@njit(**WITHIN, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def _barrier(centre: float, slope: float, gain: float, offset: float, x: float) -> tuple[float, float]:
    """B [V/m] and dB/dx."""
    w = place(gain * x + offset)
    return centre + slope * w, slope * gain * _HALF_SQRT_PI * math.exp(w * w)


@njit(**WITHIN, error_model="numpy", fastmath={"contract", "arcp", "nsz"})
def switching(law: Array, m: Material, x: float, field: float) -> tuple[float, float, float]:
    """f = dx/dt [1/s] and its derivatives by x and by the field E [V/m] (3.8 to 3.10).

    Args:
        law: shape (NUMBERS,).
        m: the material.
        x: phase fraction x+ [-].
        field: E [V/m].
    """
    width = m.thermal_width
    barrier, slope = _barrier(law[0], law[1], law[2], law[3], x)
    z = (field - barrier) / width
    up = switching_rate(z)
    up_z = up * (_TWO_BY_SQRT_PI * up - 2.0 * z)
    up_x = -up_z * slope / width
    barrier, slope = _barrier(law[4], law[5], law[6], law[7], x)
    z = (barrier - field) / width
    down = switching_rate(z)
    down_z = down * (_TWO_BY_SQRT_PI * down - 2.0 * z)
    down_x = down_z * slope / width
    per_time = 1.0 / m.relaxation_time
    f = (up * (1.0 - x) - down * x) * per_time
    f_x = (up_x * (1.0 - x) - up - down_x * x - down) * per_time
    f_e = (up_z * (1.0 - x) + down_z * x) / width * per_time
    return f, f_x, f_e


@compiled
def rate(law: Array, m: Material, x: Array, field: Array) -> Array:
    """dx/dt [1/s, shape (n,)] at many points, for tests and figures."""
    out = np.empty(x.size)
    for k in range(x.size):
        out[k], _, _ = switching(law, m, x[k], field[k])
    return out
