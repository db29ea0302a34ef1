"""An internal bias field that goes on from run to run: each finds it as the time before has left it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _SIZE = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class Imprint(Link):
    """The ceramic sees the voltage less settled_voltage - missing_voltage exp(-t/time_constant), t since the run began.

    As `bias_field`, but what builds up over a session is further on in each run, by as long as nobody recorded.
    """

    kind: ClassVar[str] = "imprint"
    section: ClassVar[str] = ACTUATOR

    missing_voltage: float = parameter(0.0, "V", "that is to build up yet as a run begins", bounds=(-1e4, 1e4))
    settled_voltage: float = parameter(0.0, "V", "internal field times layer thickness, at the end", bounds=(-1e4, 1e4))
    time_constant: float = parameter(100.0, "s", "over which it builds up", bounds=(1e-3, 1e6))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, and its time [s]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage across the ceramic to the voltage that its domains feel."""
        after, bias = self._bias(state, signals)
        return after, signals.replace(voltage=signals.voltage - bias)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage that the domains have to feel to the voltage across the ceramic; exact."""
        after, bias = self._bias(state, signals)
        return after, signals.replace(voltage=signals.voltage + bias)

    def _bias(self, state: State, signals: Signals) -> tuple[State, Array]:
        after = state.copy()
        if signals.time.size and after[_SEEN] == 0.0:
            after[_SEEN], after[_TIME] = 1.0, signals.time[0]
        left = np.exp(-(signals.time - after[_TIME]) / self.time_constant)
        return after, self.settled_voltage - self.missing_voltage * left
