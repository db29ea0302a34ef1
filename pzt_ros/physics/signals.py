"""What travels along the chain: one block of samples, each quantity an array of the same length."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ABSENT: Array = np.empty(0)
"""Stands where a quantity is not known (yet)."""

REHEARSAL: Array = np.linspace(50e-6, 200e-6, 4)
"""Sample times for a rehearsal: a step whose outcome is thrown away, so that compiled code is ready in time."""


@dataclass(frozen=True)
class Signals:
    """A block of samples on its way through the chain [every array: shape (n,), SI].

    Between samples every signal is linear. Links read what they need and replace what they change.

    Attributes:
        time: sample times [s], strictly increasing.
        voltage: the command before the amplifier's links, the voltage across the ceramic after them [V].
        polarization: P [C/m^2]; set by the ferroelectric link.
        phase_fraction: x+ [-]; set by the ferroelectric link.
        displacement: y [m]; true up to the structure, as measured after the sensor's links.
        temperature: [K], where it is known.
        force: on the stack, where it is known [N].
        neighbour: displacement of another axis of the stage, where it is known [m].
        strain_polarization: the polarization that strains [C/m^2], where it differs from P.
    """

    time: Array
    voltage: Array = field(default_factory=lambda: ABSENT)
    polarization: Array = field(default_factory=lambda: ABSENT)
    phase_fraction: Array = field(default_factory=lambda: ABSENT)
    displacement: Array = field(default_factory=lambda: ABSENT)
    temperature: Array = field(default_factory=lambda: ABSENT)
    strain_polarization: Array = field(default_factory=lambda: ABSENT)
    force: Array = field(default_factory=lambda: ABSENT)
    neighbour: Array = field(default_factory=lambda: ABSENT)

    @property
    def straining(self) -> Array:
        """The polarization that strain links go by [C/m^2]."""
        return self.strain_polarization if self.strain_polarization.size else self.polarization

    def replace(self, **changes: Array) -> Signals:
        """A copy with some quantities replaced."""
        copy = object.__new__(Signals)  # four times as fast as dataclasses.replace, which runs __init__ again
        copy.__dict__.update(self.__dict__, **changes)
        return copy


@dataclass(frozen=True)
class Rest:
    """The state of the world before the first sample.

    Attributes:
        time: of the rest point [s]; the first sample comes later (or at the same time, then its step is zero long).
        voltage: at the ceramic's amplifier [V].
        seed: of every random number the chain will draw.
        occupancy: x+ at the nodes of a grid of thresholds, for links that take their history so; absent: their own [-].
    """

    time: float = 0.0
    voltage: float = 0.0
    seed: int = 0
    occupancy: Array = field(default_factory=lambda: ABSENT, compare=False)
