"""Links before the ceramic that have to know what it draws."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass

from pzt_ros.errors import BenchError
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import Link


@dataclass(frozen=True, kw_only=True)
class Loaded(Link, ABC):
    """A link that runs a copy of the ceramic of its chain (docs/decisions/0005).

    Attributes:
        load: the ceramic; the chain puts it in.
    """

    load: Ferroelectric | None = dataclasses.field(default=None, compare=False, repr=False)

    @property
    @abstractmethod
    def feels_load(self) -> bool:
        """Whether the voltage depends on what the ceramic draws."""

    @property
    def shortcut(self) -> Link | None:
        """A link right behind the ceramic that does nearly the same and needs no load; None where there is none."""
        return None

    def driving(self, load: Ferroelectric) -> Loaded:
        """The same link with that ceramic on it, if it makes a difference."""
        return dataclasses.replace(self, load=load) if self.feels_load and self.load is not load else self


def told_their_load(links: tuple[Link, ...]) -> tuple[Link, ...]:
    """The links of a chain, those that feel the load with the chain's ceramic on them.

    Raises:
        BenchError: one stands behind the ceramic.
    """
    place = next((number for number, link in enumerate(links) if isinstance(link, Ferroelectric)), None)
    if place is None:
        return links
    load = links[place]
    assert isinstance(load, Ferroelectric)
    for link in links[place:]:
        if isinstance(link, Loaded):
            raise BenchError(f"{link.kind}: stands behind the ceramic, where no voltage counts; put it before")
    return tuple(link.driving(load) if isinstance(link, Loaded) else link for link in links)


def shortcut_of(link: Link) -> Link | None:
    """What may stand for a link behind the ceramic."""
    return link.shortcut if isinstance(link, Loaded) else None
