"""What is added to the reading whatever the stage does: undone by taking it away again."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import SENSOR, Link, State
from pzt_ros.physics.signals import Array, Signals


@dataclass(frozen=True, kw_only=True)
class AddedToReading(Link):
    """A disturbance of the displacement that depends on time and surroundings only."""

    section: ClassVar[str] = SENSOR

    @abstractmethod
    def _disturbance(self, state: State, signals: Signals) -> tuple[State, Array]:
        """The state after the block, and what is added [m, shape (n,)]."""

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement without the disturbance to displacement with it."""
        after, added = self._disturbance(state, signals)
        return after, signals.replace(displacement=signals.displacement + added)

    def carry(self, signals: Signals, change: Change) -> Change:
        """As it comes in."""
        return change

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to displacement without the disturbance; exact."""
        after, added = self._disturbance(state, signals)
        return after, signals.replace(displacement=signals.displacement - added)
