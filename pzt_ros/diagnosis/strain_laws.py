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
    declared = next((link for link in staged.chain_at(found.vector).links if _is_law(link)), None)
    kinds = [each.kind for each in staged.coordinates]
    if declared is None or kinds.count(STRAIN_LAW) == len(coordinates_of(StrainLaw())):
        return None
    law = _as_powers(declared)
    powers = coordinates_of(law)
    kept = [place for place, kind in enumerate(kinds) if kind != declared.kind]
    own = staged.ceramic.start.size
    parts = (found.vector[:own], [each.scaled(each.start) for each in powers], found.vector[own:][kept])
    freed = dataclasses.replace(
        staged,
        chain=staged.chain.with_links(lambda link: law if _is_law(link) else link),
        coordinates=(*powers, *(staged.coordinates[place] for place in kept)),
    )
    return exact(fitted(freed, np.concatenate(parts), found.effects, _STEPS))


def _is_law(link: Link) -> bool:
    return isinstance(link, Electrostriction | StrainLaw)


def _as_powers(law: Link) -> StrainLaw:
    if isinstance(law, Electrostriction):
        return StrainLaw(linear=0.0, quadratic=law.coefficient * law.active_length, cubic=0.0)
    assert isinstance(law, StrainLaw)
    return law
