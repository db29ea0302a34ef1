"""Whether all samples of a block are finite numbers: one compiled look, where NumPy takes three calls."""

from __future__ import annotations

import math

from numba import njit

from pzt_ros.physics.compiling import OUTER
from pzt_ros.physics.signals import Array


@njit(**OUTER)
def first_not_finite(values: Array) -> int:
    """Place of the first sample of `values` [shape (n,)] that is no finite number; -1 where all are."""
    for k in range(values.size):
        if not math.isfinite(values[k]):
            return k
    return -1
