"""Thermal drift of the reading: unmeasured, dying out; or driven by a measured temperature."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.added import AddedToReading
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _WARM, _TEMPERATURE, _SIZE = 0, 1, 2, 3, 4


@dataclass(frozen=True, kw_only=True)
class ThermalDrift(AddedToReading):
    """Added to the displacement: rate * time_constant * (1 - exp(-t/time_constant)) + expansion * (T - T(0)).

    One number per run (the rate at its start) and one of the stage (the time constant of its warming up; long against
    the run it means a straight line). A rate and an amount side by side would be two per run that no run of a minute
    tells apart. The expansion acts where the signals carry a temperature. Time counts from the first sample.
    """

    kind: ClassVar[str] = "thermal_drift"

    rate: float = parameter(0.0, "m/s", "rate of the drift at the first sample", bounds=(-1e-3, 1e-3))
    time_constant: float = parameter(1e5, "s", "over which the drift dies out", bounds=(1e-2, 1e6))
    expansion: float = parameter(0.0, "m/K", "displacement over temperature, where it is known", bounds=(-1e-3, 1e-3))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen and its time [s]; whether a temperature was seen and which [K]."""
        return np.zeros(_SIZE)

    def _disturbance(self, state: State, signals: Signals) -> tuple[State, Array]:
        after, drift = state.copy(), np.zeros_like(signals.time)
        if signals.time.size and after[_SEEN] == 0.0:
            after[_SEEN], after[_TIME] = 1.0, signals.time[0]
        if self.rate != 0.0:
            _warming(signals.time, drift, after[_TIME], self.rate, self.time_constant)
        if signals.temperature.size:
            if after[_WARM] == 0.0:
                after[_WARM], after[_TEMPERATURE] = 1.0, signals.temperature[0]
            drift += self.expansion * (signals.temperature - after[_TEMPERATURE])
        return after, drift


@njit(cache=True)
def _warming(time: Array, drift: Array, start: float, rate: float, time_constant: float) -> None:
    for k in range(time.size):
        drift[k] = -rate * time_constant * math.expm1(-(time[k] - start) / time_constant)
