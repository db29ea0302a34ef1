"""A load that pushes back like a spring."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class LoadStiffness(Link):
    """A spring k_L against the stack k_A leaves k_A/(k_A + k_L) of the free displacement."""

    kind: ClassVar[str] = "load_stiffness"
    section: ClassVar[str] = ACTUATOR

    load_stiffness: float = parameter(0.0, "N/m", "stiffness of the load", symbol="k_L", bounds=(0.0, 1e12))
    actuator_stiffness: float = parameter(1e8, "N/m", "stiffness of the stack", symbol="k_A", bounds=(1.0, 1e12))

    @property
    def gain(self) -> float:
        """Displacement over free displacement [-]."""
        return self.actuator_stiffness / (self.actuator_stiffness + self.load_stiffness)

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Free displacement to displacement."""
        return state, signals.replace(displacement=self.gain * signals.displacement)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to free displacement; exact."""
        return state, signals.replace(displacement=signals.displacement / self.gain)
