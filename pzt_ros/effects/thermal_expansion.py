"""Drift of the reading with a measured temperature, and with nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.effects.added import AddedToReading
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_WARM, _TEMPERATURE, _SIZE = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class ThermalExpansion(AddedToReading):
    """Added to the displacement: expansion * (T - T(0)), where the signals carry a temperature.

    One number of the stage and none of a run: where the temperature says it all, a run that nobody fitted is known.
    """

    kind: ClassVar[str] = "thermal_expansion"

    expansion: float = parameter(0.0, "m/K", "displacement over temperature, where it is known", bounds=(-1e-3, 1e-3))

    def init(self, rest: Rest) -> State:
        """Whether a temperature was seen and which [K]."""
        return np.zeros(_SIZE)

    def _disturbance(self, state: State, signals: Signals) -> tuple[State, Array]:
        after, temperature = state.copy(), signals.temperature
        if not temperature.size:
            return after, np.zeros_like(signals.time)
        if after[_WARM] == 0.0:
            after[_WARM], after[_TEMPERATURE] = 1.0, temperature[0]
        return after, self.expansion * (temperature - after[_TEMPERATURE])
