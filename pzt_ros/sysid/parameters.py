"""The parameters of a chain as a fit sees them: by name, without scale, and back into the chain."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

from pzt_ros.errors import BenchError
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import SENSOR, Link
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import Parameter, parameters_of

GIVEN = ("gain", "layer_thickness", "electrode_area", "active_length", "temperature", "virgin_amplitude")
"""Known from a data sheet or an instrument, and without an effect of their own: free only where `free:` names them."""

SHAPES = ("coercive_field_skew", "coercive_field_tail", "interaction_field_tail")
"""How densities differ from Gaussians: free only where `free:` names them, for most runs do not tell."""

LOPSIDED = "interaction_field_skew"
"""The same of interaction fields that prefer a direction, which a bias field looks much like."""

GROWTH = "interaction_field_growth"
"""The same of interaction fields that are the wider, the harder a domain is."""

SECOND = (
    "second_share",
    "second_coercive_field",
    "second_coercive_field_spread",
    "second_interaction_field_spread",
)
"""The same of domains of a second kind."""

BEYOND_GAUSSIANS = (*SHAPES, LOPSIDED, GROWTH, *SECOND)
"""All of these."""

NUMERICAL = ("accuracy", "spacing", "cut", "dead_band")
"""Settings of a method, not properties of a specimen; a fit leaves them alone, as it does the counts of nodes."""

_LEAST = 1e-9  # of the upper bound: where the logarithm of a parameter that may be 0 ends


@dataclass(frozen=True)
class FreeParameter:
    """One parameter that a fit may move.

    A positive one moves by its logarithm, so that a step means a ratio; any other by the share of its range.

    Attributes:
        name: `link.parameter`, with `link-2` for the second link of a kind.
        place: of the link in the chain.
        field: of the link.
        declared: unit and bounds [SI].
        value: where the fit starts [SI].
    """

    name: str
    place: int
    field: str
    declared: Parameter
    value: float

    @property
    def is_log(self) -> bool:
        """Whether it moves by its logarithm."""
        return self.declared.lower >= 0.0 and self.value > 0.0

    @property
    def lowest(self) -> float:
        """Lower bound of the search [SI]."""
        return max(self.declared.lower, _LEAST * self.declared.upper) if self.is_log else self.declared.lower

    def to_scaled(self, value: float) -> float:
        """SI to the fit's coordinate."""
        lower, upper = self.lowest, self.declared.upper
        return math.log(max(value, lower)) if self.is_log else (value - lower) / (upper - lower)

    def to_si(self, scaled: float) -> float:
        """The fit's coordinate to SI, within the bounds whatever rounding does."""
        lower, upper = self.lowest, self.declared.upper
        value = math.exp(scaled) if self.is_log else lower + scaled * (upper - lower)
        return min(max(value, lower), upper)

    def slope(self, value: float) -> float:
        """d(SI)/d(coordinate) at `value` [SI]."""
        return value if self.is_log else self.declared.upper - self.lowest

    @property
    def scaled_bounds(self) -> tuple[float, float]:
        """Bounds of the coordinate."""
        return self.to_scaled(self.lowest), self.to_scaled(self.declared.upper)


def link_names(chain: Chain) -> list[str]:
    """How parameters call each link: its kind, numbered from the second of a kind on."""
    kinds = [link.kind for link in chain.links]
    seen = [kinds[: place + 1].count(kind) for place, kind in enumerate(kinds)]
    return [kind if number == 1 else f"{kind}-{number}" for kind, number in zip(kinds, seen, strict=True)]


def fittable(chain: Chain) -> list[FreeParameter]:
    """Every parameter that a displacement can tell something about, in the order of the chain.

    Not the sensor's: its offset is found per run, its noise and resolution are no property of the path of the signal.
    """
    found = []
    for place, (link, name) in enumerate(zip(chain.links, link_names(chain), strict=True)):
        if link.section == SENSOR and link.kind == "displacement_sensor":
            continue
        for field, declared in parameters_of(link).items():
            numerical = field in NUMERICAL or field.startswith("nodes_")
            if not numerical and math.isfinite(declared.lower) and math.isfinite(declared.upper):
                found.append(FreeParameter(f"{name}.{field}", place, field, declared, float(getattr(link, field))))
    return found


def free_parameters(chain: Chain) -> list[FreeParameter]:
    """The parameters that the chain's `free:` names, or all that can be fitted and are not given where it has none.

    Raises:
        BenchError: `free` is no list, or names what the chain has not or what cannot be fitted.
    """
    known = {parameter.name: parameter for parameter in fittable(chain)}
    names = chain.notes.get("free")
    if names is None:
        held = (*GIVEN, *BEYOND_GAUSSIANS)
        return [parameter for parameter in known.values() if parameter.field not in held]
    if not isinstance(names, list) or not names:
        raise BenchError(f"{chain.name}: free: {names!r} is not a list of parameters; known are {', '.join(known)}")
    for name in names:
        if name not in known:
            raise BenchError(f"{chain.name}: free: unknown parameter {name!r}; known are {', '.join(known)}")
    return [parameter for name, parameter in known.items() if name in names]


def with_values(chain: Chain, parameters: Sequence[FreeParameter], values: Sequence[float] | Array) -> Chain:
    """A copy of the chain with the parameters set to `values` [SI]."""
    changes: dict[int, dict[str, float]] = {}
    for parameter, value in zip(parameters, values, strict=True):
        changes.setdefault(parameter.place, {})[parameter.field] = float(value)
    links: list[Link] = list(chain.links)
    for place, change in changes.items():
        links[place] = dataclasses.replace(links[place], **change)
    return dataclasses.replace(chain, links=tuple(links))


def without_noise(chain: Chain) -> Chain:
    """The chain as a model: its sensor adds no noise, no steps and no offset."""

    def quiet(link: Link) -> Link:
        if link.kind != "displacement_sensor":
            return link
        changes = {name: 0.0 for name in ("offset", "noise_rms", "resolution") if name in parameters_of(link)}
        return dataclasses.replace(link, **changes)

    return chain.with_links(quiet)
