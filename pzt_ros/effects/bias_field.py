"""An internal bias field (imprint), constant or building up."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _SIZE = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class InternalBias(Link):
    """What every internal bias is: the ceramic sees the voltage less what `_course` says of it."""

    section: ClassVar[str] = ACTUATOR

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, and its time [s]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage across the ceramic to the voltage that its domains feel."""
        after, bias = self._bias(state, signals.time)
        return after, signals.replace(voltage=signals.voltage - bias)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage that the domains have to feel to the voltage across the ceramic; exact."""
        after, bias = self._bias(state, signals.time)
        return after, signals.replace(voltage=signals.voltage + bias)

    def _bias(self, state: State, time: Array) -> tuple[State, Array]:
        after = state.copy()
        if time.size and after[_SEEN] == 0.0:
            after[_SEEN], after[_TIME] = 1.0, time[0]
        return after, self._course(time, float(after[_TIME]))

    @abstractmethod
    def _course(self, time: Array, begin: float) -> Array:
        """The bias [V, shape (n,)] at some times of a run that begins [both s]."""


@dataclass(frozen=True, kw_only=True)
class BiasField(InternalBias):
    """The ceramic sees the voltage less a bias: aligned defects hold on to the state they have grown used to.

    Given as a voltage across a layer, so that no thickness has to be known. The part `drift_share` of it builds up in
    the run as 1 - exp(-t/time_constant), the rest is there from the first sample on. The link belongs to the actuator:
    what amplifier and record call the applied voltage does not know of it; only links behind it see the difference.
    """

    kind: ClassVar[str] = "bias_field"

    bias_voltage: float = parameter(0.0, "V", "internal field times layer thickness, at the end", bounds=(-1e4, 1e4))
    drift_share: float = parameter(0.0, "1", "part of it that builds up in the run", bounds=(0.0, 1.0))
    time_constant: float = parameter(100.0, "s", "over which that part builds up", bounds=(1e-3, 1e6))

    def _course(self, time: Array, begin: float) -> Array:
        bias = np.full_like(time, self.bias_voltage)
        if self.drift_share > 0.0:
            _build_up(time, bias, begin, self.bias_voltage * self.drift_share, self.time_constant)
        return bias


@njit(cache=True)
def _build_up(time: Array, bias: Array, start: float, missing: float, time_constant: float) -> None:
    for k in range(time.size):
        bias[k] -= missing * math.exp(-(time[k] - start) / time_constant)
