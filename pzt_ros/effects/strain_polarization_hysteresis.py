"""Strain-polarization hysteresis as a link before any strain law (thesis 2.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.physics.strain_hysteresis import STATE_SIZE, lead, unlead
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class StrainPolarizationHysteresis(Link):
    """The polarization that strains is ahead of P after each turn: P + delta s, s the stop operator of P.

    The same physics as `strain_hysteresis`, before whatever strain law the chain has: the link sets the polarization
    that strains and leaves the polarization itself, which is what charge measures, alone.
    """

    kind: ClassVar[str] = "strain_polarization_hysteresis"
    section: ClassVar[str] = ACTUATOR

    polarization_lead: float = parameter(
        0.0, "C/m^2", "polarization by which strain is ahead", symbol="delta", bounds=(0.0, 1.0)
    )
    turn_width: float = parameter(
        0.05, "C/m^2", "change of P after a turn until strain is ahead again", symbol="w", bounds=(1e-6, 10.0)
    )

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, the last P [C/m^2], and how far the turn has come, from -w/2 to w/2 [C/m^2]."""
        return np.zeros(STATE_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization to the polarization that strains."""
        after, leading = state.copy(), np.empty_like(signals.polarization)
        lead(after, signals.polarization, leading, *self._shape)
        return after, signals.replace(strain_polarization=leading)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """The polarization that strains to polarization; exact."""
        after, polarization = state.copy(), np.empty_like(signals.straining)
        unlead(after, signals.straining, polarization, *self._shape)
        return after, signals.replace(polarization=polarization)

    @property
    def _shape(self) -> tuple[float, float]:
        """How much strain leads per turn [-], and how far a turn goes [C/m^2]."""
        return 2.0 * self.polarization_lead / self.turn_width, 0.5 * self.turn_width
