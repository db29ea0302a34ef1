"""What a controller may ask for: a window of voltage, a slew rate, and numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter

_JUST_BELOW = 1.0 - 1e-9
"""So that the guard, which rounds otherwise, does not count what was kept."""


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Of the voltage across the ceramic, named as the guard's limits (thesis 2.1).

    The guard in the amplifier stays the last word; a controller that keeps the bounds never meets it, and hears what
    they took from it, so that its integrals do not wind up.
    """

    voltage_min: float = parameter(-40.0, "V", "lowest voltage", bounds=(-1000.0, 0.0))
    voltage_max: float = parameter(150.0, "V", "highest voltage", bounds=(0.0, 1000.0))
    slew_rate: float = parameter(2e5, "V/s", "fastest change", bounds=(1.0, 5e8))

    def keep(self, wanted: Array, last: float, time: Array, before: float) -> Array:
        """The nearest voltage [V, shape of `wanted`] within the bounds that continues `last` [V].

        Args:
            wanted: [V, shape (n,)]; what is no finite number keeps the voltage before it.
            last: voltage before the block [V].
            time: of `wanted` [s, shape (n,)].
            before: time of `last` [s].
        """
        step = _JUST_BELOW * self.slew_rate * (float(time[-1]) - before) / len(time)
        return _keep(wanted, last, self.voltage_min, self.voltage_max, max(step, 0.0))


@njit(cache=True)
def _keep(wanted: Array, last: float, lowest: float, highest: float, step: float) -> Array:
    out = np.empty_like(wanted)
    for k in range(len(wanted)):
        if math.isfinite(wanted[k]):
            change = min(max(wanted[k], lowest), highest) - last
            last += min(max(change, -step), step)
        out[k] = last
    return out
