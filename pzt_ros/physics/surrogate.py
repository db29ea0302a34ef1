"""The front model in place of a polycrystal: a tenth to a twentieth of the time, and near enough to search with."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.domains import Domains
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front import Front
from pzt_ros.physics.link import Link
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameters_of

ACCURACY = 1e-4
"""Asked of a surrogate's integration; its own distance from the polycrystal is larger."""

_LOOSE = 1e-3
_MANY = 0.25  # thermal widths that the field climbs by in the mean sample: a substep of the front model

_Other = TypeVar("_Other", bound=Domains)
_TABLES = ("coercive_density", "interaction_density", "threshold_density")


def surrogate_of(model: Ferroelectric) -> Ferroelectric:
    """Two thermal fronts with the parameters of a polycrystal; any other model as it is."""
    return in_place_of(model, Front, accuracy=ACCURACY) if isinstance(model, Polycrystal) else model


def in_place_of(model: Domains, other: type[_Other], **values: Any) -> _Other:
    """Another model of the same domains, with the parameters that both have, and some values of its own [SI]."""
    shared = [name for name in parameters_of(other) if name in parameters_of(model)]
    known: dict[str, Any] = {name: getattr(model, name) for name in (*shared, *_TABLES)}
    return other(**{**known, **values})


def in_few_steps(link: Link, voltage: Array) -> Any:
    """A front model with longer substeps where a fit has made domains so narrow that each sample takes many.

    Any other link, and a front model that steps fast or is as loose already, is returned as it is.
    """
    if not isinstance(link, Front) or link.accuracy >= _LOOSE:
        return link
    climb = float(np.mean(np.abs(np.diff(voltage)))) / link.layer_thickness
    return dataclasses.replace(link, accuracy=_LOOSE) if climb > _MANY * link.thermal_width else link


def with_surrogate(chain: Chain) -> Chain:
    """The chain with a surrogate of its ceramic; the same chain where none is faster."""
    if not any(isinstance(link, Polycrystal) for link in chain.links):
        return chain
    return chain.with_links(lambda link: surrogate_of(link) if isinstance(link, Ferroelectric) else link)


def with_quick_surrogate(chain: Chain, voltage: Array) -> Chain:
    """The same for a search over one drive [V]: in few steps, too, where each sample would take many."""
    quick = with_surrogate(chain)
    if all(in_few_steps(link, voltage) is link for link in quick.links):
        return quick
    return quick.with_links(lambda link: in_few_steps(link, voltage))
