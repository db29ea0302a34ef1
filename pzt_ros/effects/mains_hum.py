"""Mains hum in the reading."""

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

_SEEN, _TIME, _SIZE = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class MainsHum(AddedToReading):
    """A tone at the frequency of the mains with its second and third harmonic; time counts from the first sample.

    How far the mains is off its nominal frequency is a parameter of its own with narrow bounds: a tone elsewhere is no
    mains hum and shall not be fitted as one.
    """

    kind: ClassVar[str] = "mains_hum"

    frequency: float = parameter(50.0, "Hz", "nominal frequency of the mains", bounds=(1.0, 1e4))
    detuning: float = parameter(0.0, "Hz", "true minus nominal frequency", bounds=(-0.5, 0.5))
    sine: float = parameter(0.0, "m", "amplitude of the sine", bounds=(-1e-3, 1e-3))
    cosine: float = parameter(0.0, "m", "amplitude of the cosine", bounds=(-1e-3, 1e-3))
    second_sine: float = parameter(0.0, "m", "sine at twice the frequency, as of rectifiers", bounds=(-1e-3, 1e-3))
    second_cosine: float = parameter(0.0, "m", "cosine at twice the frequency", bounds=(-1e-3, 1e-3))
    third_sine: float = parameter(0.0, "m", "sine at three times the frequency", bounds=(-1e-3, 1e-3))
    third_cosine: float = parameter(0.0, "m", "cosine at three times the frequency", bounds=(-1e-3, 1e-3))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, and its time [s]."""
        return np.zeros(_SIZE)

    def _disturbance(self, state: State, signals: Signals) -> tuple[State, Array]:
        after, hum = state.copy(), np.zeros_like(signals.time)
        if signals.time.size and after[_SEEN] == 0.0:
            after[_SEEN], after[_TIME] = 1.0, signals.time[0]
        tones = (self.sine, self.cosine), (self.second_sine, self.second_cosine), (self.third_sine, self.third_cosine)
        for multiple, (sine, cosine) in enumerate(tones, start=1):
            frequency = 2.0 * math.pi * multiple * (self.frequency + self.detuning)
            if sine or cosine:
                _tone(signals.time, hum, after[_TIME], frequency, math.hypot(sine, cosine), math.atan2(cosine, sine))
        return after, hum


@njit(cache=True)
def _tone(time: Array, out: Array, start: float, frequency: float, size: float, phase: float) -> None:
    for k in range(time.size):
        out[k] += size * math.sin(frequency * (time[k] - start) + phase)
