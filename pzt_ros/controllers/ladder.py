"""What a planning controller answers when its plan is missing: the rungs of a ladder, each reached within one tick."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pzt_ros.physics.signals import Array

PLAN, SHIFTED, INVERSE, HOLD, RAMP = "plan", "previous plan", "inverse", "hold", "ramp down"
"""The rungs, from best to worst."""

_NEAR = 1e-9
"""[s]; by which rounded sample times may differ."""


@dataclass(frozen=True)
class Plan:
    """Voltage [V] at sample times to come [s, shape (n,) each]."""

    time: Array
    voltage: Array

    def over(self, time: Array) -> Array | None:
        """Its part for these samples [V]; None where it does not reach."""
        if not self.time.size or time[-1] > self.time[-1] + _NEAR or time[0] < self.time[0] - _NEAR:
            return None
        return np.interp(time, self.time, self.voltage)


NO_PLAN = Plan(np.empty(0), np.empty(0))


def held_or_lowered(last: float, time: Array, before: float, lower_from: float, rate: float) -> Array:
    """The last voltage, and from a time on lowered towards 0 V [V, shape (n,)].

    Args:
        last: voltage before the block [V].
        time: of its samples [s, shape (n,)].
        before: time of the last voltage [s].
        lower_from: when to begin [s].
        rate: of the voltage [V/s].
    """
    lowered = rate * np.maximum(time - max(before, lower_from), 0.0)
    return np.sign(last) * np.maximum(abs(last) - lowered, 0.0)
