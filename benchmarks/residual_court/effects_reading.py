"""Effects in the sensor and around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .effect import READING, UPSAMPLING, Array, Effect, Run, filtered, smooth_walk, upsampled
from .families import STROKE


@dataclass(frozen=True)
class SensorLag(Effect):
    """The reading comes late: one pole, a delay, or both."""

    name = "sensor_lag"
    stage = READING
    first = 3e-4
    most = 2e-2

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"delay_share": float(rng.choice((0.0, 0.0, 0.5, 1.0)))})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is delay plus time constant [s]."""
        delay = self.amplitude * self.shape["delay_share"]
        constant = self.amplitude - delay
        if constant > 0.0:
            values = filtered(values, run.step, [1.0], [constant, 1.0])
        if delay > 0.0:
            fine = upsampled(values)
            times = np.arange(fine.size) * run.step / UPSAMPLING
            values = np.interp(run.time - run.time[0] - delay, times, fine)
        return values

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"lag": self.amplitude}


@dataclass(frozen=True)
class SensorNonlinearity(Effect):
    """The sensor's curve: a polynomial of third order, or a sine over one to two strokes."""

    name = "sensor_nonlinearity"
    stage = READING
    first = 2e-7
    most = 3e-6

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        period, phase = rng.uniform(1.0, 2.0), rng.uniform(0, 2 * np.pi)
        return cls(
            cls.first, {"sine": float(rng.random() < 0.5), "period": period, "phase": phase, "mix": rng.uniform(-1, 1)}
        )

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the largest deviation within the stroke, roughly [m]."""
        u = values / STROKE
        if self.shape["sine"]:
            bend = np.sin(2 * np.pi * u / self.shape["period"] + self.shape["phase"]) - np.sin(self.shape["phase"])
        else:
            bend = 8 * u * (u - 0.5) * (u - 1) + 2 * self.shape["mix"] * u * (u - 1)
        return values + self.amplitude * bend


@dataclass(frozen=True)
class ThermalDrift(Effect):
    """The reading drifts: linearly, dying out, by chance, or with a temperature that is recorded."""

    name = "thermal_drift"
    stage = READING
    first = 1e-7

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        kind = float(rng.integers(4))
        return cls(
            cls.first, {"kind": kind, "sign": float(rng.choice((-1, 1))), "time_constant": rng.uniform(5.0, 40.0)}
        )

    @property
    def measured(self) -> bool:
        """Whether the temperature that drives it is recorded."""
        return self.shape["kind"] == 3

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the drift over 30 s, or over 1 K [m]; without a temperature no two runs drift alike.

        Unless it is steady: what drifts alike in every run is what creep can be taken for.
        """
        kind, rng = self.shape["kind"], run.rng("drift")
        pace = rng.uniform(0.6, 1.4) if kind < 3 and not self.shape.get("steady") else 1.0
        if kind == 0:
            course = run.time / 30.0
        elif kind == 1:
            course = 1 - np.exp(-run.time / self.shape["time_constant"])
        elif kind == 2:
            course = smooth_walk(rng, run.time, 6.0)
        else:
            course = run.temperature - run.temperature[0]
        return values + self.amplitude * self.shape["sign"] * pace * course

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"expansion": self.amplitude * self.shape["sign"]} if self.measured else {}


@dataclass(frozen=True)
class MainsHum(Effect):
    """The mains with two harmonics, its frequency a little off and its phase another in each run."""

    name = "mains_hum"
    stage = READING
    first = 2e-8

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        mains = float(rng.choice((50.0, 60.0)))
        return cls(cls.first, {"frequency": mains + rng.uniform(-0.05, 0.05), "harmonics": rng.uniform(0.0, 0.3)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude of the first harmonic [m]."""
        phase = 2 * np.pi * self.shape["frequency"] * run.time + run.rng("hum").uniform(0, 2 * np.pi)
        third, second = self.shape["harmonics"], 0.5 * self.shape["harmonics"]
        return values + self.amplitude * (np.sin(phase) + second * np.sin(2 * phase) + third * np.sin(3 * phase + 1.0))

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"detuning": self.shape["frequency"] - 10 * round(self.shape["frequency"] / 10)}
