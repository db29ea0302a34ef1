"""Identified densities held by stronger priors than the one that served best without an effect.

Without the effect that is there, a density has to bend to make up for it, so a weak prior predicts best. Beside the
effect it need not, and a weak prior then only lets it wander where the fitted runs do not tell.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Protocol, TypeVar


class Held(Protocol):
    """What has a prior on its density."""

    rotation_strength: float


_Held = TypeVar("_Held", bound=Held)

STRENGTHS = (10.0, 100.0)
"""Of the rotation prior."""


def stiffer_of(ceramic: _Held) -> Iterator[_Held]:
    """Copies with a density that is more even along constant coercive field."""
    for strength in STRENGTHS:
        if strength > ceramic.rotation_strength:
            yield held_by(ceramic, strength)


def held_by(ceramic: _Held, strength: float) -> _Held:
    """A copy with another strength of the rotation prior [-]."""
    found = copy.copy(ceramic)
    found.rotation_strength = strength
    return found
