"""Drives of the court: commanded voltage over time, put together from ramps, holds and sines."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.float64]

SLOW_RATE = 1_000.0
"""Samples per second of the long runs."""

FAST_RATE = 10_000.0
"""Samples per second of the short runs for what happens within milliseconds."""

LOW, HIGH = -30.0, 140.0
"""Where minor loops turn [V]; poling goes to 150 V."""

POLING = 150.0


@dataclass(frozen=True)
class Drive:
    """A commanded voltage.

    Attributes:
        time: evenly spaced, from 0 [s].
        command: [V].
        hidden: samples at the beginning that the record does not show: an unknown past.
        loaded: whether a spring stands against the actuator in this run.
    """

    time: Array
    command: Array
    hidden: int = 0
    loaded: bool = False

    @property
    def step(self) -> float:
        """Sampling interval [s]."""
        return float(self.time[1] - self.time[0])


@dataclass
class Program:
    """Voltages one after another, from 0 V on."""

    rate: float = SLOW_RATE
    pieces: list[Array] = field(default_factory=lambda: [np.zeros(1)])

    @property
    def last(self) -> float:
        """Where it stands now [V]."""
        return float(self.pieces[-1][-1])

    @property
    def duration(self) -> float:
        """So far [s]."""
        return (sum(piece.size for piece in self.pieces) - 1) / self.rate

    def _phase(self, seconds: float) -> Array:
        count = max(1, round(seconds * self.rate))
        return np.arange(1, count + 1) / count

    def to(self, voltage: float, seconds: float, smooth: bool = False) -> Program:
        """A ramp, linear or a half sine."""
        share = self._phase(seconds)
        share = 0.5 * (1 - np.cos(np.pi * share)) if smooth else share
        self.pieces.append(self.last + (voltage - self.last) * share)
        return self

    def hold(self, seconds: float) -> Program:
        """Stay."""
        self.pieces.append(np.full(max(1, round(seconds * self.rate)), self.last))
        return self

    def sine(self, amplitude: float, frequency: float, cycles: float) -> Program:
        """Whole or half cycles around where it stands."""
        share = self._phase(cycles / frequency)
        self.pieces.append(self.last + amplitude * np.sin(2 * np.pi * cycles * share))
        return self

    def chirp(self, amplitude: float, low: float, high: float, seconds: float) -> Program:
        """A sine of rising frequency, faded in and out so that it ends where it began."""
        share = self._phase(seconds)
        fade = np.minimum(1.0, 12 * np.minimum(share, 1 - share))
        self.pieces.append(self.last + amplitude * fade * signal.chirp(share * seconds, low, seconds, high, phi=-90))
        return self

    def until(self, seconds: float) -> Program:
        """Hold on, or stop early, so that the whole has this length."""
        count = round(seconds * self.rate)
        whole = np.concatenate(self.pieces)
        short = max(0, count - whole.size)
        self.pieces = [np.concatenate([whole[:count], np.full(short, whole[-1])])]
        return self

    def drive(self, hidden: float = 0.0, loaded: bool = False) -> Drive:
        """What was put together; the first `hidden` seconds are not recorded."""
        command = np.concatenate(self.pieces)
        return Drive(np.arange(command.size) / self.rate, command, round(hidden * self.rate), loaded)


def poled(seconds: float, rest: float, rate: float = SLOW_RATE) -> Program:
    """The thesis' initialisation: half a sine up to 150 V, and a hold."""
    return Program(rate).to(POLING, seconds, smooth=True).hold(rest)


def wander(program: Program, rng: np.random.Generator, until: float, rates: tuple[float, float]) -> Program:
    """Minor loops between random reversals at random rates [V/s], with holds of 0.3 to 3 s on one in three."""
    low_rate, high_rate = np.log(rates)
    upward = False
    while program.duration < until:
        room = (LOW, program.last - 8) if not upward else (program.last + 8, HIGH)
        target = rng.uniform(*room) if room[1] > room[0] else (HIGH if upward else LOW)
        rate = np.exp(rng.uniform(low_rate, high_rate))
        program.to(target, max(abs(target - program.last) / rate, 0.05), smooth=rng.random() < 0.5)
        if rng.random() < 1 / 3:
            program.hold(rng.uniform(0.3, 3.0))
        upward = not upward
    return program.until(until)


def sines(program: Program, rng: np.random.Generator, plan: tuple[tuple[float, float], ...]) -> Program:
    """Sines of (frequency [Hz], cycles) with random middles and amplitudes."""
    for frequency, cycles in plan:
        amplitude = rng.uniform(18, 55) if frequency < 20 else rng.uniform(15, 30)
        program.to(rng.uniform(LOW + amplitude, HIGH - amplitude), 0.4, smooth=True).hold(0.15)
        program.sine(amplitude, frequency, cycles).hold(0.1)
    return program


def burst(rng: np.random.Generator) -> Drive:
    """A second at 10 kHz: a fast poling, steps, a chirp to 400 Hz and fast ramps."""
    program = poled(0.15, 0.03, FAST_RATE).to(rng.uniform(50, 80), 0.1, smooth=True).hold(0.05)
    for _ in range(3):
        program.to(program.last + rng.choice((-1, 1)) * rng.uniform(8, 20), 0.0004).hold(0.06)
    program.chirp(rng.uniform(6, 10), 20.0, 400.0, 0.45).hold(0.02)
    return program.to(rng.uniform(90, 120), 0.05).to(rng.uniform(10, 40), 0.08).hold(0.02).drive()
