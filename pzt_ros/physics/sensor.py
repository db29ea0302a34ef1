"""The displacement sensor at the end of the chain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.link import SENSOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class DisplacementSensor(Link):
    """Zero offset, white noise and a least step.

    The noise is a function of seed and sample number alone, so a run repeats to the bit however it is cut into blocks.
    """

    kind: ClassVar[str] = "displacement_sensor"
    section: ClassVar[str] = SENSOR

    offset: float = parameter(0.0, "m", "reading at zero displacement", symbol="y0", bounds=(-1.0, 1.0))
    noise_rms: float = parameter(0.0, "m", "white noise, standard deviation", bounds=(0.0, 1e-3))
    resolution: float = parameter(0.0, "m", "least step of the reading; 0 for none", bounds=(0.0, 1e-3))

    def init(self, rest: Rest) -> State:
        """Number of the next sample, and the seed."""
        return np.array([0.0, float(rest.seed)])

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """True displacement to reading."""
        first, seed = int(state[0]), int(state[1])
        count = len(signals.time)
        reading = signals.displacement + self.offset
        if self.noise_rms > 0.0:
            reading = reading + self.noise_rms * white_noise(seed, first, count)
        if self.resolution > 0.0:
            reading = np.round(reading / self.resolution) * self.resolution
        return np.array([float(first + count), state[1]]), signals.replace(displacement=reading)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Reading wanted to true displacement; noise and resolution cannot be undone."""
        moved = np.array([state[0] + len(signals.time), state[1]])
        return moved, signals.replace(displacement=signals.displacement - self.offset)


@njit(cache=True)
def white_noise(seed: int, first: int, count: int) -> Array:
    """Standard normal numbers for the samples `first` to `first + count` [shape (count,)].

    A counter-based generator: SplitMix64 (Steele et al. 2014) of seed and sample number, then Box and Muller.
    """
    out = np.empty(count)
    for i in range(count):
        key = np.uint64(seed) * np.uint64(0xD1342543DE82EF95) + np.uint64(2 * (first + i))
        u = (np.float64(_splitmix64(key) >> np.uint64(11)) + 0.5) / 9007199254740992.0
        v = np.float64(_splitmix64(key + np.uint64(1)) >> np.uint64(11)) / 9007199254740992.0
        out[i] = math.sqrt(-2.0 * math.log(u)) * math.cos(2.0 * math.pi * v)
    return out


@njit(cache=True)
def _splitmix64(key: np.uint64) -> np.uint64:
    z = key * np.uint64(0x9E3779B97F4A7C15) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
