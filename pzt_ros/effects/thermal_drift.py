"""Thermal drift of the reading: unmeasured, dying out; and with a measured temperature where there is one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.thermal_expansion import ThermalExpansion
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _SIZE = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class ThermalDrift(ThermalExpansion):
    """Added to the displacement: rate * time_constant * (1 - exp(-t/time_constant)) + expansion * (T - T(0)).

    One number per run (the rate at its start) and one of the stage (the time constant of its warming up; long against
    the run it means a straight line). A rate and an amount side by side would be two per run that no run of a minute
    tells apart. Time counts from the first sample.
    """

    kind: ClassVar[str] = "thermal_drift"

    rate: float = parameter(0.0, "m/s", "rate of the drift at the first sample", bounds=(-1e-3, 1e-3))
    time_constant: float = parameter(1e5, "s", "over which the drift dies out", bounds=(1e-2, 1e6))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen and its time [s]; then the state of the expansion."""
        return np.concatenate((np.zeros(_SIZE), super().init(rest)))

    def _disturbance(self, state: State, signals: Signals) -> tuple[State, Array]:
        expanded, drift = super()._disturbance(state[_SIZE:], signals)
        after = np.concatenate((state[:_SIZE], expanded))
        if signals.time.size and after[_SEEN] == 0.0:
            after[_SEEN], after[_TIME] = 1.0, signals.time[0]
        if self.rate != 0.0:
            _warming(signals.time, drift, after[_TIME], self.rate, self.time_constant)
        return after, drift


@njit(cache=True)
def _warming(time: Array, drift: Array, start: float, rate: float, time_constant: float) -> None:
    for k in range(time.size):
        drift[k] -= rate * time_constant * math.expm1(-(time[k] - start) / time_constant)
