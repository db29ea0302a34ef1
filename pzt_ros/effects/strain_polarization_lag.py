"""Strain that hangs back behind the polarization after each turn, where that was recorded: a play before a law."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.strain_hysteresis import begun, lead, lead_of_change, unlead
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class StrainPolarizationLag(Link):
    """A share of the polarization that strains follows P by a play operator: (1 - c) P + c play(P).

    The other sign of `StrainPolarizationHysteresis`. Without a record of P it is one more play in the hysteresis of the
    ceramic, and no effect of its own.
    """

    kind: ClassVar[str] = "strain_polarization_lag"
    section: ClassVar[str] = ACTUATOR
    follows_turns: ClassVar[bool] = True

    lagging_share: float = parameter(0.0, "1", "share of P that strains late", symbol="c", bounds=(0.0, 0.9))
    play: float = parameter(
        0.01, "C/m^2", "change of P after the middle of a turn until it follows", symbol="r", bounds=(1e-6, 10.0)
    )

    def init(self, rest: Rest) -> State:
        """See `begun`."""
        return begun(1)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization to the polarization that strains."""
        after, late = state.copy(), np.empty_like(signals.polarization)
        lead(after, signals.polarization, late, *self._shape)
        return after, signals.replace(strain_polarization=late)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The change without that of the turns that are still going on."""
        late = lead_of_change(signals.polarization, change.polarization, *self._shape)
        return replace(change, strain_polarization=late)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """The polarization that strains to polarization; exact."""
        after, polarization = state.copy(), np.empty_like(signals.straining)
        unlead(after, signals.straining, polarization, *self._shape)
        return after, signals.replace(polarization=polarization)

    @property
    def _shape(self) -> tuple[Array, Array]:
        """By how much strain is ahead per turn [-], and how far a turn goes to both sides [C/m^2]: P - play(P)."""
        return np.array([-self.lagging_share]), np.array([self.play])
