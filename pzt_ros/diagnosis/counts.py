"""What an effect that goes on from run to run has gone through before each, by the polarization that a model gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pzt_ros.diagnosis.coordinates import Coordinate, coordinate
from pzt_ros.effects.effect import GoesOn
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array


def counts_before(field: str, link: Link, polarizations: Sequence[Array]) -> tuple[Coordinate, ...]:
    """What a link has gone through before each run, in their order; none of one that is the same again after a run.

    Args:
        field: that counts it.
        link: of the effect.
        polarizations: of all runs, as the link gets them [C/m^2].
    """
    if not isinstance(link, GoesOn):
        return ()
    counts = [link.gone_through(polarization) for polarization in polarizations]
    links = [replace(link, **{field: float(count)}) for count in (0.0, *np.cumsum(counts[:-1]))]
    return tuple(coordinate(each, field, run=number) for number, each in enumerate(links))
