"""A mode of the structure that the sensor sees in part."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.effects.mode import STATE_SIZE, follow, follow_columns, lead, settles
from pzt_ros.effects.sampling import mode_gains
from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter

_DIES_OUT = 1.0
"""By how much errors of the exact inverse have to shrink per sample."""


@dataclass(frozen=True, kw_only=True)
class MechanicalResonance(Link):
    """y + share * deflection of a mode driven by y; share 1 is a mode in the path of the motion, less one beside it.

    The same as (1 - share) * y + share * mode(y). The link starts at rest wherever its first sample is.
    """

    kind: ClassVar[str] = "mechanical_resonance"
    section: ClassVar[str] = ACTUATOR

    share: float = parameter(0.0, "1", "part of the displacement that passes the mode", bounds=(0.0, 1.0))
    frequency: float = parameter(500.0, "Hz", "undamped frequency of the mode", symbol="f_0", bounds=(0.1, 1e6))
    damping_ratio: float = parameter(
        0.02, "1", "damping over critical; above a half nothing rings", symbol="D", bounds=(1e-4, 0.5)
    )

    def prompt(self) -> MechanicalResonance:
        """Without the mode."""
        return dataclasses.replace(self, share=0.0) if self.share > 0.0 else self

    def inverse_looks_back(self, step: float) -> bool:
        """Where nearly all passes a finely sampled mode."""
        frequency, damping, share = self._mode
        return share > 0.0 and not settles(mode_gains(step, frequency, damping), share, _DIES_OUT)

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; time [s], input [m], last step [s], deflection [m] and velocity [m/s]."""
        return np.zeros(STATE_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement before the mode to displacement."""
        after, out = state.copy(), np.empty_like(signals.displacement)
        follow(after, signals.time, signals.displacement, out, *self._mode)
        return after, signals.replace(displacement=out)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The change with what the mode makes of it: the link is linear."""
        out = np.empty_like(change.displacement, order="C")
        follow_columns(signals.time, change.displacement, out, *self._mode)
        return dataclasses.replace(change, displacement=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to displacement before the mode; exact unless nearly all passes a finely sampled mode.

        There the exact inverse rings without end; velocity and acceleration are then differences of what is wanted.
        """
        after, needed = state.copy(), np.empty_like(signals.displacement)
        lead(after, signals.time, signals.displacement, needed, *self._mode, _DIES_OUT)
        return after, signals.replace(displacement=needed)

    @property
    def _mode(self) -> tuple[float, float, float]:
        return 2.0 * math.pi * self.frequency, self.damping_ratio, self.share
