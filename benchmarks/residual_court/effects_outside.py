"""Effects that the library has no link for: the diagnosis must say that something unexplained remains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from .effect import MOTION, READING, Array, Effect, Run, smooth_walk
from .families import STROKE
from .operators import play


@dataclass(frozen=True)
class Backlash(Effect):
    """Clearance between actuator and what it moves."""

    name = "backlash"
    stage = MOTION
    first = 2e-8

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first)

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is half the clearance [m]."""
        return play(values, self.amplitude, float(values[0]))


@dataclass(frozen=True)
class GainDrift(Effect):
    """The gain of the sensor wanders with time."""

    name = "gain_drift"
    stage = READING
    first = 0.01

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"correlation": rng.uniform(2.0, 6.0)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the typical change of gain [-]."""
        return values * (1 + self.amplitude * smooth_walk(run.rng("gain"), run.time, self.shape["correlation"]))


@dataclass(frozen=True)
class Tone(Effect):
    """A pump or a fan at 37 Hz, not the mains."""

    name = "tone"
    stage = READING
    first = 2e-8

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"frequency": rng.uniform(34.0, 41.0)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude [m]."""
        phase = run.rng("tone").uniform(0, 2 * np.pi)
        return values + self.amplitude * np.sin(2 * np.pi * self.shape["frequency"] * run.time + phase)


@dataclass(frozen=True)
class Telegraph(Effect):
    """The reading jumps between two levels at random, as with a bad contact."""

    name = "telegraph"
    stage = READING
    first = 4e-8

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"rate": rng.uniform(0.4, 3.0)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the height of the jumps [m]."""
        rng = run.rng("telegraph")
        jumps = np.cumsum(rng.exponential(1 / self.shape["rate"], size=int(4 * self.shape["rate"] * run.time[-1]) + 20))
        return values + self.amplitude * (np.searchsorted(jumps, run.time) % 2)


@dataclass(frozen=True)
class SlowWave(Effect):
    """An air conditioner: a slow sine in the reading."""

    name = "slow_wave"
    stage = READING
    first = 3e-8

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"period": rng.uniform(4.0, 9.0)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude [m]."""
        phase = run.rng("wave").uniform(0, 2 * np.pi)
        return values + self.amplitude * np.sin(2 * np.pi * run.time / self.shape["period"] + phase)


@dataclass(frozen=True)
class FringeError(Effect):
    """An interferometer's periodic error: many periods within the stroke, no smooth sensor curve."""

    name = "fringe_error"
    stage = READING
    first = 1e-8

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"period": rng.uniform(0.3e-6, 0.8e-6)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude [m]."""
        return values + self.amplitude * np.sin(2 * np.pi * values / self.shape["period"])


@dataclass(frozen=True)
class SelfHeating(Effect):
    """The mean position falls with the square of the rate of motion: self-heating, gone within seconds."""

    name = "self_heating"
    stage = READING
    first = 1e-7

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"time_constant": rng.uniform(1.0, 4.0)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the shift for a motion of 20 strokes per second [m]."""
        loss = (np.gradient(values, run.step) / (20 * STROKE)) ** 2
        share = np.exp(-run.step / self.shape["time_constant"])
        return values - self.amplitude * signal.lfilter([1 - share], [1, -share], loss)


@dataclass(frozen=True)
class LostReadings(Effect):
    """Single readings that the sensor's interface made up: a bad contact, a lost bit."""

    name = "lost_readings"
    stage = READING
    first = 2e-7

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"share": rng.uniform(5e-4, 4e-3)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the typical height [m]."""
        rng = run.rng("lost")
        lost = rng.random(values.size) < self.shape["share"]
        heights = rng.choice((-1.0, 1.0), values.size) * rng.uniform(0.5, 1.5, values.size)
        return values + self.amplitude * lost * heights
