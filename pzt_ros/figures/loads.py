"""The loads of chapter 3: straight lines of the field from turn to turn, and what a ceramic does under them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.signals import Array, Rest, Signals

RATE = 10.0
"""Of the simulations in 3.2.3 and 3.3 [kV/mm/s]."""

NESTED_LOOPS = (
    *(2, -2, 2, -1, 1, -0.7, 0.7, -2, 0.4, -0.2, 0.8, 0.2, 1.2, 0.5, 2),
    *(-0.4, 0.2, -0.8, -0.2, -1.2, -0.5, -2, 0.6, -0.6, 0.4, -0.4, 2, -2, 2),
)
"""Turns [kV/mm]. The thesis does not print its own; these have what it names: minor loops, biased and nested ones, and
loops that close together."""


@dataclass(frozen=True, eq=False)
class Load:
    """A field over time, linear between samples.

    Attributes:
        time: [s], from 0, shape (n,).
        field: [kV/mm].
        ends: sample at which each leg ends.
    """

    time: Array
    field: Array
    ends: tuple[int, ...]

    def leg(self, number: int) -> slice:
        """The samples of a leg, both turns included."""
        ends = (0, *self.ends)
        return slice(ends[number], ends[number + 1] + 1)

    @property
    def legs(self) -> list[slice]:
        """All of them."""
        return [self.leg(number) for number in range(len(self.ends))]


def ramps(turns: Sequence[float], samples: int, rate: float = RATE) -> Load:
    """Straight lines from 0 to one turn after the other [kV/mm] at a rate [kV/mm/s], each of `samples` samples."""
    field, duration = [0.0], [0.0]
    for turn in turns:
        leg = np.linspace(field[-1], turn, samples + 1)[1:]
        duration += [abs(turn - field[-1]) / samples / rate] * samples
        field += leg.tolist()
    ends = tuple(samples * (k + 1) for k in range(len(turns)))
    return Load(np.cumsum(duration), np.array(field), ends)


def respond(ceramic: Ferroelectric, load: Load) -> Signals:
    """What a ceramic makes of a load, from its own initial state."""
    voltage = 1e6 * load.field * ceramic.layer_thickness
    return ceramic.step(ceramic.init(Rest()), Signals(time=load.time, voltage=voltage))[1]
