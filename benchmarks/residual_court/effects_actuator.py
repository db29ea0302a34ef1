"""Effects in amplifier, ceramic and structure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from .effect import BIAS, CHARGE, CURRENT, DRIVE, LEAD, MOTION, POLARIZATION, Array, Effect, Run, filtered
from .families import LAYER
from .operators import play


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


@dataclass(frozen=True)
class AmplifierBandwidth(Effect):
    """The voltage follows the command through one pole, and in one case of three a second one far above."""

    name = "amplifier_bandwidth"
    stage = DRIVE
    first = 3e-4
    most = 2e-2

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"second_pole": float(rng.choice((0.0, 0.0, 0.1)))})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the time constant [s]; the command is linear between its samples."""
        second = self.shape["second_pole"] * self.amplitude
        denominator = [self.amplitude * second, self.amplitude + second, 1.0] if second else [self.amplitude, 1.0]
        b, a, _ = signal.cont2discrete(([1.0], denominator), run.step, method="foh")
        b, a = np.ravel(b), np.ravel(a)
        return signal.lfilter(b, a, values, zi=signal.lfilter_zi(b, a) * values[0])[0]

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"time_constant": self.amplitude * (1.0 + self.shape["second_pole"])}


@dataclass(frozen=True)
class CurrentLimit(Effect):
    """The amplifier delivers no more than a current; the truth works it out from the ceramic's own C dV/dt."""

    name = "amplifier_current_limit"
    stage = CURRENT
    first = 200.0

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first)

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is one over the limit [1/A]."""
        return np.minimum(values, 1.0 / self.amplitude)

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"current_limit": 1.0 / self.amplitude}


@dataclass(frozen=True)
class BiasField(Effect):
    """An imprint that builds up with time: exponential, or like log(1 + t)."""

    name = "bias_field"
    stage = BIAS
    first = 1e4
    most = 6e5

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        shape = {"sign": float(rng.choice((-1, 1))), "time_constant": _log_uniform(rng, 8.0, 60.0)}
        return cls(cls.first, {**shape, "logarithmic": float(rng.random() < 0.3)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the field in the end [V/m]; the next run begins afresh."""
        late = run.time / self.shape["time_constant"]
        growth = np.log1p(late) if self.shape["logarithmic"] else 1 - np.exp(-late)
        return values + self.shape["sign"] * self.amplitude * growth

    def parameters(self) -> dict[str, float]:
        """See Effect; the library's bias points against the field."""
        if self.shape["logarithmic"]:
            return {}
        voltage = -self.shape["sign"] * self.amplitude * LAYER
        return {"bias_voltage": voltage, "time_constant": self.shape["time_constant"]}


@dataclass(frozen=True)
class Fatigue(Effect):
    """P falls towards 1 - amplitude, exponentially with the way that it has gone; half of them tire from run to run."""

    name = "polarization_fatigue"
    stage = POLARIZATION
    first = 0.02
    most = 0.6

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"way": _log_uniform(rng, 4.0, 40.0), "carried_over": float(rng.random() < 0.5)})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the part lost in the end [-]."""
        way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])
        way = way + (run.travel if self.shape["carried_over"] else 0.0)
        return values * (1 - self.amplitude * (1 - np.exp(-way / self.shape["way"])))


@dataclass(frozen=True)
class StrainLead(Effect):
    """Strain belongs to a P that is ahead: P less a play behind it; in half the cases three plays of other widths."""

    name = "strain_polarization_hysteresis"
    stage = LEAD
    first = 0.005
    most = 0.1

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first, {"turn_width": rng.uniform(0.02, 0.08), "plays": float(rng.choice((1, 3)))})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the lead delta [C/m^2]."""
        factors = (1.0,) if self.shape["plays"] == 1 else (0.4, 1.0, 1.8)
        ahead = np.zeros_like(values)
        for factor in factors:
            radius = 0.5 * factor * self.shape["turn_width"]
            ahead += (values - play(values, radius, float(values[0]))) / radius
        return values + self.amplitude * ahead / len(factors)

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        if self.shape["plays"] != 1:
            return {}
        return {"polarization_lead": self.amplitude, "turn_width": self.shape["turn_width"]}


@dataclass(frozen=True)
class Leakage(Effect):
    """Charge that leaks through the ceramic is measured as polarization; displacement does not know."""

    name = "leakage"
    stage = CHARGE
    first = 1e-4

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first)

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is conductance over area [S/m^2]."""
        charge = np.cumsum(0.5 * (run.command[1:] + run.command[:-1])) * run.step
        return values + self.amplitude * np.concatenate([[0.0], charge])

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"areal_conductance": self.amplitude}


@dataclass(frozen=True)
class Creep(Effect):
    """Late displacement behind the prompt one: one or two Kelvin-Voigt states, or creep with the logarithm of time."""

    name = "slow_relaxation"
    stage = MOTION
    first = 0.01
    most = 0.6

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        states = float(rng.choice((1, 2, 12)))
        shortest = 0.02 if states == 12 else _log_uniform(rng, 0.05, 4.0)
        longest = 60.0 if states == 12 else shortest * (1.0 if states == 1 else _log_uniform(rng, 3.0, 15.0))
        return cls(cls.first, {"states": states, "shortest_time": shortest, "longest_time": longest})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is late over prompt displacement [-]; 12 states spread evenly make it logarithmic."""
        states = int(self.shape["states"])
        times = np.geomspace(self.shape["shortest_time"], self.shape["longest_time"], states)
        late = np.zeros_like(values)
        for time in times:
            b, a, _ = signal.cont2discrete(([1.0], [float(time), 1.0]), run.step, method="foh")
            b, a = np.ravel(b), np.ravel(a)
            late += signal.lfilter(b, a, values, zi=signal.lfilter_zi(b, a) * values[0])[0] / states
        return values + self.amplitude * late

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"share": self.amplitude} if self.shape["states"] == 1 else {}


@dataclass(frozen=True)
class Resonance(Effect):
    """Part of the motion reaches the sensor through a mode."""

    name = "mechanical_resonance"
    stage = MOTION
    first = 0.02
    most = 1.0

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        frequency, damping = _log_uniform(rng, 100.0, 380.0), _log_uniform(rng, 0.01, 0.06)
        return cls(cls.first, {"frequency": frequency, "damping_ratio": damping})

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the part that passes the mode [-]."""
        omega, damping = 2 * np.pi * self.shape["frequency"], self.shape["damping_ratio"]
        mode = filtered(values, run.step, [omega**2], [1.0, 2 * damping * omega, omega**2])
        return (1 - self.amplitude) * values + self.amplitude * mode

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"share": self.amplitude, **self.shape}


@dataclass(frozen=True)
class Load(Effect):
    """A spring stands against the actuator in some of the runs; its force is recorded."""

    name = "load_stiffness"
    stage = MOTION
    first = 0.01
    most = 1.0

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """See Effect."""
        return cls(cls.first)

    def act(self, run: Run, values: Array) -> Array:
        """Amplitude is the load's stiffness over the stack's of 1e8 N/m [-]."""
        return values / (1 + self.amplitude) if run.loaded else values

    def parameters(self) -> dict[str, float]:
        """See Effect."""
        return {"load_stiffness": 1e8 * self.amplitude}
