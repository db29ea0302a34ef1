"""What stands behind the ceramic in a search for links before it that run a copy of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State, no_state
from pzt_ros.physics.loaded import shortcut_of
from pzt_ros.physics.signals import Array, Rest, Signals


def shortcuts_of(links: Sequence[Link]) -> list[Link]:
    """What may stand behind the ceramic, in the order of the links that it stands for."""
    return [shortcut for shortcut in map(shortcut_of, links) if shortcut]


@dataclass(frozen=True)
class Beyond:
    """What P of a run has beyond that of shortcuts, near where it was found.

    Attributes:
        values: there [C/m^2, shape (n,)].
        at: coordinates there, by name.
        slopes: how it changes with those of the links that the shortcuts stand for [C/m^2, shape (n,)].
    """

    values: Array
    at: Mapping[str, float]
    slopes: Mapping[str, Array]

    def near(self, coordinates: Mapping[str, float]) -> Link:
        """What adds it, elsewhere near by; a coordinate that is no longer sought is where it was."""
        moved = {name: coordinates[name] - self.at[name] for name in self.slopes if name in coordinates}
        return _More(polarization=self.values + sum(way * self.slopes[name] for name, way in moved.items()))


@dataclass(frozen=True, kw_only=True)
class _More(Link):
    """So much more polarization at each sample of a run [C/m^2, shape (n,)]."""

    kind: ClassVar[str] = "more"
    section: ClassVar[str] = ACTUATOR

    polarization: Array

    def init(self, rest: Rest) -> State:
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        return state, signals.replace(polarization=signals.polarization + self.polarization)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        return state, signals.replace(polarization=signals.polarization - self.polarization)

    def carry(self, signals: Signals, change: Change) -> Change:
        return change
