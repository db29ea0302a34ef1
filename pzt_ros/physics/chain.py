"""The signal chain: links in a row, run forwards or walked backwards."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pzt_ros.physics.link import ACTUATOR, SENSOR, Link, State
from pzt_ros.physics.loaded import told_their_load
from pzt_ros.physics.signals import Rest, Signals

ChainState = tuple[State, ...]


@dataclass(frozen=True)
class Chain:
    """A nanopositioning stage, or a part of one, as a row of links.

    Attributes:
        name: of the chain, for people.
        links: in the order of the signal, from the command to the measurement.
        notes: what else its file says (description, source, fit); data for people and later tools.
    """

    name: str
    links: tuple[Link, ...]
    notes: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """A link that feels the load is told which ceramic it drives (docs/decisions/0005)."""
        object.__setattr__(self, "links", told_their_load(self.links))

    def init(self, rest: Rest) -> ChainState:
        """The state at rest of every link."""
        return tuple(link.init(rest) for link in self.links)

    def step(self, state: ChainState, signals: Signals) -> tuple[ChainState, Signals]:
        """Run a block forwards: from the voltage that comes in to the displacement that comes out."""
        after = []
        for link, memory in zip(self.links, state, strict=True):
            memory, signals = link.step(memory, signals)
            after.append(memory)
        return tuple(after), signals

    def invert(self, state: ChainState, signals: Signals) -> tuple[ChainState, Signals]:
        """Walk a block backwards: from the displacement wanted to the voltage that gives it."""
        after = []
        for link, memory in zip(reversed(self.links), reversed(state), strict=True):
            memory, signals = link.invert(memory, signals)
            after.append(memory)
        return tuple(reversed(after)), signals

    def section(self, *names: str) -> Chain:
        """The part of the chain that lives in the named sections."""
        return dataclasses.replace(self, links=tuple(link for link in self.links if link.section in names))

    @functools.cached_property
    def behind_amplifier(self) -> Chain:
        """What follows the voltage across the ceramic: actuator and sensor."""
        return self.section(ACTUATOR, SENSOR)

    def with_links(self, change: Callable[[Link], Link]) -> Chain:
        """A copy in which every link went through `change`."""
        return dataclasses.replace(self, links=tuple(change(link) for link in self.links))
