"""Motion of the axis beside it that comes through the guidance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.signals import Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class CrossCoupling(Link):
    """The stage moves by a share of what another axis moves: own displacement plus coupling times the neighbour's.

    It acts where the signals carry the neighbour's displacement. The share may grow with it, as in a guidance that
    tilts: coupling * (1 + bend * y) * y.
    """

    kind: ClassVar[str] = "cross_coupling"
    section: ClassVar[str] = ACTUATOR

    coupling: float = parameter(0.0, "1", "displacement over that of the neighbour", bounds=(-1.0, 1.0))
    bend: float = parameter(0.0, "1/m", "growth of the coupling with the neighbour's displacement", bounds=(-1e6, 1e6))

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Own displacement to displacement."""
        y = signals.neighbour
        if not y.size:
            return state, signals
        return state, signals.replace(displacement=signals.displacement + self.coupling * (1.0 + self.bend * y) * y)

    def carry(self, signals: Signals, change: Change) -> Change:
        """As it comes in."""
        return change

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to own displacement; exact."""
        y = signals.neighbour
        if not y.size:
            return state, signals
        return state, signals.replace(displacement=signals.displacement - self.coupling * (1.0 + self.bend * y) * y)
