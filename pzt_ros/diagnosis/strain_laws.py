"""Strain laws with more powers than were declared: what a sensor's curve looks like to displacement alone.

A power of the polarization more is the same whether the ceramic or the sensor has it (diagnosis-methods.md 3.3).
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pzt_ros.diagnosis.coordinates import Coordinate, coordinate
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.physics.link import Link
from pzt_ros.physics.strain import Electrostriction
from pzt_ros.physics.strain_law import StrainLaw

STRAIN_LAW = StrainLaw.kind
"""In the place of an effect, see effects/confounded.py."""

_TYPICAL_POLARIZATION = 0.25  # C/m^2
_STEPS = 40


def coordinates_of(law: StrainLaw) -> tuple[Coordinate, Coordinate, Coordinate]:
    """Of the linear, quadratic and cubic coefficient, in units of what moves the stage as far as the largest does."""
    p = _TYPICAL_POLARIZATION
    size = max(abs(law.linear), abs(law.quadratic) * p, abs(law.cubic) * p**2)
    return (
        coordinate(law, "linear", typical=size),
        coordinate(law, "quadratic", typical=size / p),
        coordinate(law, "cubic", typical=size / p**2),
    )


def with_free_law(found: Hypothesis) -> Hypothesis | None:
    """The hypothesis refitted with a strain law up to the third power; None where it has one, or no law at all."""
    staged = found.staged
    law = next((law for law in map(as_powers, staged.chain_at(found.vector).links) if law is not None), None)
    if law is None:
        return None
    powers = coordinates_of(law)
    names = {each.name for each in powers}
    if names <= {each.name for each in staged.coordinates}:
        return None
    others = [
        place
        for place, each in enumerate(staged.coordinates)
        if each.kind != Electrostriction.kind and each.name not in names
    ]
    own = staged.ceramic.start.size
    start = (found.vector[:own], [each.scaled(each.start) for each in powers], found.vector[own:][others])
    freed = dataclasses.replace(
        staged,
        chain=staged.chain.with_links(lambda link: link if as_powers(link) is None else law),
        coordinates=(*powers, *(staged.coordinates[place] for place in others)),
    )
    return exact(fitted(freed, np.concatenate(start), found.effects, _STEPS))


def as_powers(link: Link) -> StrainLaw | None:
    """A link as a strain law with coefficients of powers of P; None where it is none."""
    if isinstance(link, Electrostriction):
        return StrainLaw(quadratic=link.coefficient * link.active_length)
    return link if isinstance(link, StrainLaw) else None
