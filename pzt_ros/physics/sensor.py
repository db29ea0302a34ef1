"""The displacement sensor at the end of the chain."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.errors import BenchError
from pzt_ros.physics.linear_response import lag_inverse, lag_step
from pzt_ros.physics.link import SENSOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SAMPLE, _SEED, _SEEN, _TIME, _INPUT, _OUTPUT, _NEXT, _HEAD = 0, 1, 2, 3, 4, 5, 6, 7


@dataclass(frozen=True, kw_only=True)
class DisplacementSensor(Link):
    """Bandwidth, delay, zero offset, white noise and a least step, in this order.

    The noise is a function of seed and sample number alone, so a run repeats to the bit however it is cut into blocks.
    The lag and the delay start in balance wherever the first sample is.
    """

    kind: ClassVar[str] = "displacement_sensor"
    section: ClassVar[str] = SENSOR

    offset: float = parameter(0.0, "m", "reading at zero displacement", symbol="y0", bounds=(-1.0, 1.0))
    noise_rms: float = parameter(0.0, "m", "white noise, standard deviation", bounds=(0.0, 1e-3))
    resolution: float = parameter(0.0, "m", "least step of the reading; 0 for none", bounds=(0.0, 1e-3))
    bandwidth: float = parameter(0.0, "Hz", "corner of a first-order lag; 0 for no lag", bounds=(0.0, 1e9))
    delay: float = parameter(0.0, "1", "samples by which the reading comes late", bounds=(0.0, 1e5))

    def noiseless(self) -> DisplacementSensor:
        """Without noise and least step."""
        return dataclasses.replace(self, noise_rms=0.0, resolution=0.0)

    def prompt(self) -> DisplacementSensor:
        """Without lag and delay."""
        return dataclasses.replace(self, bandwidth=0.0, delay=0.0) if self._dynamic else self

    @property
    def _dynamic(self) -> bool:
        return self.bandwidth > 0.0 or self.delay > 0.0

    @property
    def _time_constant(self) -> float:
        return 1.0 / (2.0 * math.pi * self.bandwidth) if self.bandwidth > 0.0 else 0.0

    def init(self, rest: Rest) -> State:
        """Number of the next sample and the seed; with a lag or a delay also what is under way.

        Raises:
            BenchError: a delay that is no whole number of samples.
        """
        if self.delay != int(self.delay):
            raise BenchError(f"displacement_sensor.delay: {self.delay:g} is no whole number of samples; give one")
        under_way = _HEAD - 2 + int(self.delay) if self._dynamic else 0
        return np.array([0.0, float(rest.seed), *np.zeros(under_way)])

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """True displacement to reading."""
        after = state.copy()
        seen = signals.displacement
        if self._dynamic:
            seen = np.empty_like(seen)
            _follow(after, signals.time, signals.displacement, seen, self._time_constant)
        first, seed = int(state[_SAMPLE]), int(state[_SEED])
        count = len(signals.time)
        reading = seen + self.offset
        if self.noise_rms > 0.0:
            reading = reading + self.noise_rms * white_noise(seed, first, count)
        if self.resolution > 0.0:
            reading = np.rint(reading / self.resolution) * self.resolution
        after[_SAMPLE] = float(first + count)
        return after, signals.replace(displacement=reading)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Reading wanted to true displacement; noise, resolution and delay cannot be undone.

        The lag is undone exactly where sampling is slower than its time constant, else by differences.
        """
        after = state.copy()
        after[_SAMPLE] += len(signals.time)
        needed = signals.displacement - self.offset
        if self._dynamic:
            wanted, needed = needed, np.empty_like(needed)
            _lead(after, signals.time, wanted, needed, self._time_constant)
        return after, signals.replace(displacement=needed)


@njit(cache=True)
def _begin(state: Array, time: float, displacement: float) -> None:
    """In balance at the first sample."""
    state[_SEEN], state[_TIME], state[_INPUT], state[_OUTPUT] = 1.0, time, displacement, displacement
    state[_HEAD:] = displacement


@njit(cache=True)
def _late(state: Array, value: float) -> float:
    """Put a value into the ring of those under way and take out the oldest."""
    delay = state.size - _HEAD
    if delay == 0:
        return value
    place = int(state[_NEXT])
    oldest = state[_HEAD + place]
    state[_HEAD + place] = value
    state[_NEXT] = (place + 1) % delay
    return oldest


@njit(cache=True)
def _follow(state: Array, time: Array, displacement: Array, out: Array, time_constant: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], displacement[k])
        if time_constant > 0.0:
            step = time[k] - state[_TIME]
            state[_OUTPUT] = lag_step(state[_OUTPUT], state[_INPUT], displacement[k], step, time_constant)
        else:
            state[_OUTPUT] = displacement[k]
        state[_TIME], state[_INPUT] = time[k], displacement[k]
        out[k] = _late(state, state[_OUTPUT])


@njit(cache=True)
def _lead(state: Array, time: Array, wanted: Array, out: Array, time_constant: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k])
        out[k] = wanted[k]
        if time_constant > 0.0:
            step = time[k] - state[_TIME]
            out[k] = lag_inverse(wanted[k], state[_OUTPUT], state[_INPUT], step, time_constant)
        state[_TIME], state[_INPUT], state[_OUTPUT] = time[k], out[k], wanted[k]
        _late(state, wanted[k])


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
