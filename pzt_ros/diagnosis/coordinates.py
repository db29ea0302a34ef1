"""The unknowns of a diagnosis: parameters of links as numbers of order one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pzt_ros.effects.effect import Effect
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import Link
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameters_of

_LARGEST_RATIO = 1e6  # of a scale parameter to where its search starts
_WIDE = 1.5  # a positive parameter that may grow by more than this is a scale; a share of 1 is not


@dataclass(frozen=True)
class Coordinate:
    """One parameter of one link, without unit.

    A scale (a time, a frequency, a coefficient) moves by its logarithm, so that a step means a ratio; a parameter that
    may be 0 or negative moves in units of a typical value.

    Attributes:
        kind: of the link.
        field: of the parameter.
        start: SI.
        typical: SI; the unit of a coordinate that is no logarithm.
        is_log: as above.
        lower, upper: bounds [SI].
        unit: of the SI value.
        run: index of the run that it belongs to; None for the stage's own.
    """

    kind: str
    field: str
    start: float
    typical: float
    is_log: bool
    lower: float
    upper: float
    unit: str
    run: int | None = None

    @property
    def name(self) -> str:
        """`link.parameter`, with the number of the run where it belongs to one."""
        return self.parameter + (f" of run {self.run + 1}" if self.run is not None else "")

    @property
    def parameter(self) -> str:
        """`link.parameter`."""
        return f"{self.kind}.{self.field}"

    def scaled(self, value: float) -> float:
        """SI to coordinate."""
        return math.log(value / self.typical) if self.is_log else value / self.typical

    def si(self, scaled: float) -> float:
        """Coordinate to SI, within the bounds whatever rounding does."""
        value = self.typical * math.exp(scaled) if self.is_log else self.typical * scaled
        return min(max(value, self.lower), self.upper)

    def slope(self, value: float) -> float:
        """d(SI)/d(coordinate) at `value` [SI]."""
        return value if self.is_log else self.typical

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the coordinate."""
        return self.scaled(self.lower), self.scaled(self.upper)


def coordinate(link: Link, field: str, typical: float = 0.0, run: int | None = None) -> Coordinate:
    """The coordinate of a parameter that starts at the link's value; linear in units of `typical` where given."""
    declared = parameters_of(link)[field]
    value = float(getattr(link, field))
    if typical == 0.0 and declared.lower >= 0.0 and value > 0.0 and declared.upper > _WIDE * value:
        lower, upper = max(declared.lower, value / _LARGEST_RATIO), min(declared.upper, value * _LARGEST_RATIO)
        return Coordinate(link.kind, field, value, value, True, lower, upper, declared.unit, run)
    unit = abs(typical) or max(abs(declared.lower), abs(declared.upper))
    if not math.isfinite(unit):
        unit = abs(value) or 1.0
    return Coordinate(link.kind, field, value, unit, False, declared.lower, declared.upper, declared.unit, run)


def of_effect(effect: Effect, link: Link, runs: Iterable[int]) -> list[Coordinate]:
    """What a fit may move of an effect that starts as `link`; what belongs to runs comes last, run by run."""
    typical = {field: typical_value(effect, link, field) for field in (*effect.columns, *effect.additive)}
    shared = [field for field in effect.free if field not in effect.per_run]
    found = [coordinate(link, field, typical.get(field, 0.0)) for field in shared]
    return found + [coordinate(link, field, typical[field], run) for run in runs for field in effect.per_run]


def typical_value(effect: Effect, link: Link, field: str) -> float:
    """Size of a linear parameter in a search: as it starts, or as the amplitude starts where it starts at 0."""
    return abs(float(getattr(link, field))) or abs(float(getattr(link, effect.amplitude)))


def with_coordinates(chain: Chain, coordinates: Sequence[Coordinate], vector: Array, run: int | None) -> Chain:
    """A copy of the chain with the coordinates' values; of those that belong to runs only the ones of `run`."""
    changes: dict[str, dict[str, float]] = {}
    for each, scaled in zip(coordinates, vector, strict=True):
        if each.run is None or each.run == run:
            changes.setdefault(each.kind, {})[each.field] = each.si(float(scaled))
    return chain.with_links(lambda link: _changed(link, changes))


def _changed(link: Link, changes: Mapping[str, Mapping[str, float]]) -> Link:
    return dataclasses.replace(link, **changes[link.kind]) if link.kind in changes else link
