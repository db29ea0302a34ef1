"""Effects put into a chain, taken out of it, and found in it."""

from __future__ import annotations

import dataclasses

from pzt_ros.effects.effect import AT_COMMAND, AT_DISPLACEMENT, AT_FIELD, AT_POLARIZATION, AT_SENSOR
from pzt_ros.effects.table import EFFECT_OF, EFFECTS
from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import AMPLIFIER, SENSOR, Link
from pzt_ros.physics.structure import Structure

_COMMAND, _CERAMIC, _STRAIN, _STRUCTURE, _READING = "command", "ceramic", "strain link", "structure link", "reading"
_ORDER = (
    _COMMAND, AT_COMMAND, AT_FIELD, _CERAMIC, AT_POLARIZATION, _STRAIN, AT_DISPLACEMENT, _STRUCTURE, AT_SENSOR,
    _READING,
)  # fmt: skip
"""The links every stage has, and the places of effects between them."""


def with_effect(chain: Chain, link: Link) -> Chain:
    """The chain with an effect's link at its place; one of the same kind is replaced.

    Several at one place stand in the order of EFFECTS.

    Raises:
        BenchError: the link is no effect.
    """
    if link.kind not in EFFECT_OF:
        raise BenchError(f"'{link.kind}' is no effect; known are {', '.join(EFFECT_OF)}")
    others = without_effect(chain, link.kind).links
    place = next((i for i, other in enumerate(others) if _rank(other) > _rank(link)), len(others))
    return dataclasses.replace(chain, links=(*others[:place], link, *others[place:]))


def without_effect(chain: Chain, name: str) -> Chain:
    """The chain without the effect of that name."""
    return dataclasses.replace(chain, links=tuple(link for link in chain.links if link.kind != name))


def effects_in(chain: Chain) -> list[Link]:
    """The links of the chain that are effects, in the order of the signal."""
    return [link for link in chain.links if link.kind in EFFECT_OF]


def _rank(link: Link) -> tuple[int, int]:
    """Where a link stands in a chain: its place, and its number there."""
    if link.kind in EFFECT_OF:
        effect = EFFECT_OF[link.kind]
        return _ORDER.index(effect.place), EFFECTS.index(effect)
    return _ORDER.index(_home(link)), 0


def _home(link: Link) -> str:
    if link.section == AMPLIFIER:
        return _COMMAND
    if link.section == SENSOR:
        return _READING
    if isinstance(link, Ferroelectric):
        return _CERAMIC
    return _STRUCTURE if isinstance(link, Structure) else _STRAIN
