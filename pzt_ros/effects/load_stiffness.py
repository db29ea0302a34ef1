"""A load that pushes back."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class LoadStiffness(Link):
    """The stack gives way to the force on it: free displacement less compliance times force.

    Where the signals carry the force, it is that one. Where not, it is that of a spring k_L: 1/(1 + k_L c) of the free
    displacement is left, a gain, which no run without its force can tell from the strain law's.
    """

    kind: ClassVar[str] = "load_stiffness"
    section: ClassVar[str] = ACTUATOR

    compliance: float = parameter(0.0, "m/N", "of the stack, 1/k_A; 0 for none", symbol="c", bounds=(0.0, 1.0))
    load_stiffness: float = parameter(
        1e6, "N/m", "of a spring, where the force is not known", symbol="k_L", bounds=(0.0, 1e12)
    )

    @property
    def gain(self) -> float:
        """Displacement over free displacement against the spring [-]."""
        return 1.0 / (1.0 + self.load_stiffness * self.compliance)

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Free displacement to displacement."""
        if signals.force.size:
            return state, signals.replace(displacement=signals.displacement - self.compliance * signals.force)
        return state, signals.replace(displacement=self.gain * signals.displacement)

    def carry(self, signals: Signals, change: Change) -> Change:
        """As it comes in, or the share of it that the spring leaves."""
        return change if signals.force.size else replace(change, displacement=self.gain * change.displacement)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to free displacement; exact."""
        if signals.force.size:
            return state, signals.replace(displacement=signals.displacement + self.compliance * signals.force)
        return state, signals.replace(displacement=signals.displacement / self.gain)
