"""Drives put together move by move, smooth, no steeper than an amplifier can follow, within given voltages."""

from __future__ import annotations

import math

import numpy as np

from pzt_ros.physics.signals import Array

_FADE = 12.0  # a chirp is faded in and out over a twelfth of its length


class Programme:
    """A commanded voltage from 0 V on; each method adds to it and returns it, so that calls can be chained.

    Args:
        rate: samples per second.
        slew: steepest change [V/s]; what would be steeper takes longer, or has a smaller amplitude.
        low, high: voltages that are not left [V].
    """

    def __init__(self, rate: float, slew: float, low: float, high: float) -> None:
        self.rate, self.slew = rate, slew
        self.low, self.high = min(low, 0.0), max(high, 0.0)  # it starts at 0 V
        self._pieces: list[Array] = [np.zeros(1)]

    @property
    def last(self) -> float:
        """Where it stands [V]."""
        return float(self._pieces[-1][-1])

    @property
    def voltage(self) -> Array:
        """All of it [V, shape (n,)]."""
        return np.concatenate(self._pieces)

    @property
    def time(self) -> Array:
        """From 0 [s, shape (n,)]."""
        return np.arange(sum(piece.size for piece in self._pieces)) / self.rate

    def to(self, voltage: float, seconds: float = 0.0) -> Programme:
        """Half a sine to a voltage, as fast as allowed where no time is given."""
        target = min(max(voltage, self.low), self.high)
        way = target - self.last
        phase = self._phase(max(seconds, 0.5 * math.pi * abs(way) / self.slew))
        return self._add(self.last + 0.5 * way * (1.0 - np.cos(np.pi * phase)))

    def hold(self, seconds: float) -> Programme:
        """Stay."""
        return self._add(np.full(self._phase(seconds).size, self.last))

    def loops(self, turn: float, frequency: float, count: int) -> Programme:
        """Whole cycles from where it stands to `turn` [V] and back; a smaller swing where that would be too steep."""
        most = self.slew / (math.pi * frequency)
        target = min(max(turn, self.low), self.high)
        swing = math.copysign(min(abs(target - self.last), most), target - self.last)
        phase = self._phase(count / frequency)
        return self._add(self.last + 0.5 * swing * (1.0 - np.cos(2.0 * np.pi * count * phase)))

    def pulse(self, voltage: float, width: float, rest: float) -> Programme:
        """To a voltage, `width` seconds there, back, and `rest` seconds."""
        before = self.last
        return self.to(voltage).hold(width).to(before).hold(rest)

    def chirp(self, amplitude: float, first: float, last: float, seconds: float) -> Programme:
        """A sine about where it stands, from one frequency to another in equal times for each octave [V, Hz, Hz, s]."""
        phase = self._phase(seconds)
        pace = math.log(last / first)
        frequency = first * np.exp(pace * phase)
        turned = 2.0 * np.pi * first * seconds * np.expm1(pace * phase) / pace
        room = min(amplitude, self.high - self.last, self.last - self.low)
        size = np.minimum(room, 0.9 * self.slew / (2.0 * np.pi * frequency))
        return self._add(self.last + np.minimum(1.0, _FADE * np.minimum(phase, 1.0 - phase)) * size * np.sin(turned))

    def _phase(self, seconds: float) -> Array:
        """Samples of a piece, from above 0 to 1."""
        count = max(1, math.ceil(seconds * self.rate))
        return np.arange(1, count + 1) / count

    def _add(self, piece: Array) -> Programme:
        self._pieces.append(piece)
        return self
