"""What an effect of the court is, and the run it acts in."""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import interpolate, signal

Array = NDArray[np.float64]

DRIVE, BIAS, CURRENT, POLARIZATION, LEAD, CHARGE, MOTION, READING = (
    "drive", "bias", "current", "polarization", "lead", "charge", "motion", "reading",
)  # fmt: skip
STAGES = (DRIVE, BIAS, CURRENT, POLARIZATION, LEAD, CHARGE, MOTION, READING)
"""Where an effect acts: command to voltage [V]; added field [V/m]; current limit [A]; P to P [C/m^2]; P to the P that
strains; recorded P; displacement to displacement [m]; displacement to reading [m]."""

UPSAMPLING = 8
"""Points per sample on which motion between samples is followed."""


@dataclass(frozen=True)
class Run:
    """One run of one specimen.

    Attributes:
        time, command: from the first sample, recorded or hidden [s, V].
        temperature: of the stage [K].
        number: runs before it; what differs from run to run is drawn from it and the seed.
        seed: of the case.
        loaded: whether the load is on.
        travel: way of P in the runs before [C/m^2].
    """

    time: Array
    command: Array
    temperature: Array
    number: int
    seed: int
    loaded: bool = False
    travel: float = 0.0

    @property
    def step(self) -> float:
        """Sampling interval [s]."""
        return float(self.time[1] - self.time[0])

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers of this run for one purpose, the same whenever asked."""
        return np.random.default_rng([self.seed, self.number, zlib.crc32(purpose.encode())])


@dataclass(frozen=True)
class Effect(ABC):
    """An effect with its shape drawn and its amplitude to be scaled.

    Attributes:
        amplitude: what is scaled; 0 is no effect.
        shape: everything else that was drawn.
        name, stage: as in contract.md, or of an effect outside the library; one of STAGES.
        first: amplitude to start the scaling from.
        most: amplitude beyond which it would be another thing.
    """

    amplitude: float = 0.0
    shape: Mapping[str, float] = field(default_factory=dict)
    name: ClassVar[str]
    stage: ClassVar[str]
    first: ClassVar[float]
    most: ClassVar[float] = np.inf

    @classmethod
    @abstractmethod
    def drawn(cls, rng: np.random.Generator) -> Effect:
        """One with a random shape and the amplitude `first`."""

    @abstractmethod
    def act(self, run: Run, values: Array) -> Array:
        """What comes out of its stage for what goes in."""

    def parameters(self) -> dict[str, float]:
        """True parameters by the library's names [SI]; only those for which the truth is within the library's law."""
        return {}


def filtered(values: Array, step: float, numerator: list[float], denominator: list[float]) -> Array:
    """A linear system behind a motion [values at samples, out likewise], at rest at the first sample.

    State space with a first-order hold, on an upsampled spline through the samples.
    """
    fine = upsampled(values)
    discrete = signal.cont2discrete((numerator, denominator), step / UPSAMPLING, method="foh")
    b, a = np.ravel(discrete[0]), np.ravel(discrete[1])
    out, _ = signal.lfilter(b, a, fine, zi=signal.lfilter_zi(b, a) * fine[0])
    return out[::UPSAMPLING]


def upsampled(values: Array) -> Array:
    """UPSAMPLING points per sample through a cubic spline, the last sample once."""
    samples = np.arange(values.size)
    spline = interpolate.make_interp_spline(samples, values, k=3)
    return spline(np.arange((values.size - 1) * UPSAMPLING + 1) / UPSAMPLING)


def smooth_walk(rng: np.random.Generator, time: Array, correlation: float) -> Array:
    """A random curve of unit size that changes over `correlation` seconds."""
    knots = int(np.ceil(time[-1] / correlation)) + 4
    walk = np.cumsum(rng.normal(size=knots))
    curve = interpolate.PchipInterpolator(correlation * (np.arange(knots) - 1), walk)(time)
    return (curve - curve[0]) / np.sqrt(knots)
