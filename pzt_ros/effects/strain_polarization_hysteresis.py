"""Strain-polarization hysteresis as a link before any strain law (thesis 2.2.2)."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain_hysteresis import begun, lead, lead_of_change, stops, unlead
from pzt_ros.quantities import parameter


class StrainsByTurns(Link):
    """A link before any strain law: the polarization that strains differs from P by what its turns have come to.

    The polarization itself, which is what charge measures, stays as it is.
    """

    section: ClassVar[str] = ACTUATOR
    follows_turns: ClassVar[bool] = True

    def init(self, rest: Rest) -> State:
        """See `begun`."""
        return begun(self._shape[1].size)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization to the polarization that strains."""
        after, leading = state.copy(), np.empty_like(signals.polarization)
        lead(after, signals.polarization, leading, *self._shape)
        return after, signals.replace(strain_polarization=leading)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The change with that of the turns that are still going on."""
        ahead = lead_of_change(signals.polarization, change.polarization, *self._shape)
        return replace(change, strain_polarization=ahead)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """The polarization that strains to polarization; exact."""
        after, polarization = state.copy(), np.empty_like(signals.straining)
        unlead(after, signals.straining, polarization, *self._shape)
        return after, signals.replace(polarization=polarization)

    @property
    @abstractmethod
    def _shape(self) -> tuple[Array, Array]:
        """By how much strain is ahead per turn [-], and how far a turn goes to both sides [C/m^2], for each of some."""


@dataclass(frozen=True, kw_only=True)
class StrainPolarizationHysteresis(StrainsByTurns):
    """The polarization that strains is ahead of P after each turn: P + delta s, s the mean of stop operators of P.

    Not all domains of a polycrystal turn as wide: the stops have the widths w e^-g_1, w and w e^g_2. The physics is
    that of `strain_hysteresis`, before whatever strain law the chain has.
    """

    kind: ClassVar[str] = "strain_polarization_hysteresis"

    polarization_lead: float = parameter(
        0.0, "C/m^2", "polarization by which strain is ahead", symbol="delta", bounds=(0.0, 1.0)
    )
    turn_width: float = parameter(
        0.05, "C/m^2", "change of P after a turn until strain is ahead again", symbol="w", bounds=(1e-6, 10.0)
    )
    spread_below: float = parameter(
        0.0, "1", "logarithm of the middle width over the narrowest", symbol="g_1", bounds=(0.0, 2.0)
    )
    spread_above: float = parameter(
        0.0, "1", "logarithm of the widest width over the middle one", symbol="g_2", bounds=(0.0, 2.0)
    )

    @property
    def _shape(self) -> tuple[Array, Array]:
        spreads = np.array([-self.spread_below, 0.0, self.spread_above])
        return stops(self.polarization_lead, self.turn_width * np.exp(spreads))
