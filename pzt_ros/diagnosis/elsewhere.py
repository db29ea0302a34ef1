"""Refits of what was found from elsewhere.

A density that is free bends until an effect on the polarization of a wrong shape all but fits, and no step leads on
from there. Three plays of 10 x the noise were found as two of one width and one of more than twice that, and runs never
given predicted to 1.4 and 2.0 x, from widths well apart to 1.1 and 1.0 x; one play was found as three, and 1.25 x, as
one 1.07 x.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import product

import numpy as np

from pzt_ros.diagnosis.coordinates import Coordinate, with_coordinates
from pzt_ros.diagnosis.finish import finished
from pzt_ros.diagnosis.flexible_preisach import FlexiblePreisach
from pzt_ros.diagnosis.hypothesis import Hypothesis, exact, fitted
from pzt_ros.diagnosis.settings import Thresholds
from pzt_ros.effects.strain_polarization_hysteresis import StrainPolarizationHysteresis
from pzt_ros.errors import BenchError

_KIND, _SPREADS = StrainPolarizationHysteresis.kind, ("spread_below", "spread_above")
_APART = 0.75  # logarithm of the ratio of two widths next to each other
_FEW = 40  # unknowns up to which a fit takes less than a second
_CELLS, _WIDTHS, _LEADS = 10, (0.1, 0.2, 0.4), (0.03, 0.08)
"""Of few relays over their range, and widths and leads over the span of P that are held beside them in turn."""
_PLACES = ((0.1, 0.03), (0.25, 0.03), (0.15, 0.06))
"""Middle width and lead over the span of P, from where it is sought beside a few unknowns. Of 36 stages of two Dahl
elements with one play or three of 10 x the noise, a fit from where a screen begins left more than 1.05 x of 27, up to
2.8; from these places, 1.07 x of two."""


def from_elsewhere(found: Hypothesis, asked: Thresholds) -> Hypothesis:
    """The best of a model and of what is found with one width and from three that are well apart.

    It is the model itself where that has no hysteresis of the strain with several widths. Beside a few unknowns, as of
    elements that slip, it is sought from more places: those bend until a lead that is too small all but fits.
    """
    places = _places(found)
    if not places.keys() >= set(_SPREADS):
        return found
    tried = [found]
    with suppress(BenchError):  # a model that cannot be evaluated there
        tried.append(finished(_fitted_beside(found, {places[field]: 0.0 for field in _SPREADS}), True))
        for begin in (_widths_apart(found), *(_begin_of(found, *each) for each in _PLACES if _has_few_unknowns(found))):
            if min(max(each.ratios) for each in tried) > asked.settled:
                tried.append(_fitted_from(found, begin))
    return min(tried, key=lambda each: each.total)


def from_elsewhere_soon(found: Hypothesis, asked: Thresholds) -> Hypothesis:
    """The same before it is known whether an effect is worth it, where a fit takes less than a second."""
    if max(found.ratios) <= asked.settled:
        return found
    return from_elsewhere(found, asked) if _has_few_unknowns(found) else _on_few_relays(found)


def _on_few_relays(found: Hypothesis) -> Hypothesis:
    """The best of a model and of what is found on fewer relays, from the best of many widths and leads held in turn.

    Relays that were identified without it have bent for it, however many they are. A few are identified beside each in
    half a second.
    """
    ceramic = found.staged.ceramic
    if not isinstance(ceramic, FlexiblePreisach) or found.staged.has_past or not _places(found).keys() >= set(_SPREADS):
        return found
    few, vector = ceramic.on_cells(_CELLS, found.vector[: ceramic.start.size])
    vector = np.concatenate((vector, found.vector[ceramic.start.size :]))
    tried = [found]
    with suppress(BenchError):  # a model that cannot be evaluated there
        there = fitted(replace(found.staged, ceramic=few), vector, found.effects, 0)
        begins = [_begin_of(there, *each) for each in product(_WIDTHS, _LEADS, (0.0, _APART))]
        best = min(begins, key=lambda begin: _fitted_beside(there, begin).total)
        tried.append(_fitted_from(there, best))
    return min(tried, key=lambda each: each.total)


def _has_few_unknowns(found: Hypothesis) -> bool:
    return found.staged.ceramic.knows_no_rate and found.vector.size <= _FEW


def _widths_apart(found: Hypothesis) -> dict[int, float]:
    """Three widths evenly about the middle of the narrowest and the widest, and the lead as it is [SI]."""
    places = _places(found)
    values = {field: _coordinate(found, place).si(float(found.vector[place])) for field, place in places.items()}
    below, above = (values[field] for field in _SPREADS)
    middle = values["turn_width"] * math.exp(0.5 * (above - below))
    values.update(turn_width=middle, spread_below=_APART, spread_above=_APART)
    return {place: values[field] for field, place in places.items()}


def _begin_of(found: Hypothesis, width: float, lead: float, apart: float = _APART) -> dict[int, float]:
    """A width and a lead over how far P goes, and how far widths are apart, whatever was found [SI]."""
    span = max(float(np.ptp(polarization)) for polarization in found.staged.polarizations(found.vector))
    values = {"polarization_lead": lead * span, "turn_width": width * span}
    return {place: values.get(field, apart) for field, place in _places(found).items()}


def _fitted_from(found: Hypothesis, begin: Mapping[int, float]) -> Hypothesis:
    """Fitted from other values of some coordinates [SI]; first all others, with those held."""
    vector = found.vector.copy()
    vector[_others(found, begin)] = _fitted_beside(found, begin).vector
    vector[list(begin)] = [_coordinate(found, place).scaled(value) for place, value in begin.items()]
    return finished(fitted(found.staged, vector, found.effects), True)


def _places(found: Hypothesis) -> dict[str, int]:
    """Where the fields of the hysteresis stand in the vector."""
    known = enumerate(found.staged.coordinates, start=found.staged.ceramic.start.size)
    return {each.field: place for place, each in known if each.kind == _KIND}


def _coordinate(found: Hypothesis, place: int) -> Coordinate:
    return found.staged.coordinates[place - found.staged.ceramic.start.size]


def _others(found: Hypothesis, places: Mapping[int, float]) -> list[int]:
    return [place for place in range(found.vector.size) if place not in places]


def _fitted_beside(found: Hypothesis, held: Mapping[int, float]) -> Hypothesis:
    """Fitted again, some coordinates no longer sought but at the values given [SI]."""
    staged, others = found.staged, _others(found, held)
    known = [_coordinate(found, place) for place in held]
    values = np.array([each.scaled(value) for each, value in zip(known, held.values(), strict=True)])
    beside = replace(
        staged,
        chain=with_coordinates(staged.chain, known, values, None),
        coordinates=tuple(_coordinate(found, place) for place in others if place >= staged.ceramic.start.size),
    )
    return exact(fitted(beside, found.vector[others], found.effects))
