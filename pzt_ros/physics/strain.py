"""From polarization to the displacement of the stack (thesis 2.2.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from pzt_ros.physics.change import Change, scaled
from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class Electrostriction(Link):
    """Strain as the square of the polarization: S = zeta P^2, y = S times the active length.

    The thesis prints zeta = 2.293 for S in percent. It calls the law "in need of further development": measured S over
    P shows a loop, which this link has not; `strain_hysteresis` in its place has.
    """

    kind: ClassVar[str] = "electrostriction"
    section: ClassVar[str] = ACTUATOR

    coefficient: float = parameter(0.02293, "m^4/C^2", "strain over P^2", symbol="zeta", bounds=(1e-6, 1e3))
    active_length: float = parameter(8e-3, "m", "layers times their thickness", bounds=(1e-6, 1.0))

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization to displacement."""
        return state, signals.replace(displacement=self.coefficient * self.active_length * signals.straining**2)

    def carry(self, signals: Signals, change: Change) -> Change:
        """Twice P times its change."""
        slope = 2.0 * self.coefficient * self.active_length * signals.straining
        return replace(change, displacement=scaled(slope, change.straining))

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement to polarization, on the positive branch that a poled actuator works on."""
        square = signals.displacement / (self.coefficient * self.active_length)
        polarization = np.sqrt(np.maximum(square, 0.0))
        return state, signals.replace(polarization=polarization, strain_polarization=polarization)
