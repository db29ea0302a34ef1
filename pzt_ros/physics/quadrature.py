"""The polycrystal by quadrature (thesis 3.2.2): few, freely placed domains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Density, Nodes, equal_probability, gauss_legendre, thesis_constant
from pzt_ros.physics.kinds import Kind
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import choice, parameter

_COUNT = (1.0, 1000.0)


@dataclass(frozen=True, kw_only=True)
class Quadrature(Polycrystal):
    """Polarization as a weighted sum over nodes of coercive and interaction field (3.16).

    The thesis' nodes are good to 0.7 % of x+ with 16 x 16 (methods.md 1.4); `equal_probability` needs no cut and does
    as well for any spread; with 1000 domains or more the lattice is better and faster.
    """

    kind: ClassVar[str] = "quadrature"

    nodes_coercive_above: float = parameter(10.0, "1", "nodes above the densest coercive field", bounds=_COUNT)
    nodes_coercive_below: float = parameter(6.0, "1", "nodes below it", bounds=_COUNT)
    nodes_interaction_side: float = parameter(8.0, "1", "nodes on each side of interaction field 0", bounds=_COUNT)
    rule: str = choice(
        "thesis",
        ("thesis", "equal_probability"),
        "Gauss-Legendre to 3 sigma, split at the peak; or the middles of equally likely classes",
    )
    normalization: str = choice(
        "exact", ("exact", "thesis"), "weights sum to 1, or to what the thesis' program makes them sum to (about 0.997)"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.threshold_density is not None:
            raise BenchError(f"{self.kind}: threshold_density needs domains on a lattice; use lattice or front")

    def nodes(self) -> tuple[Nodes, Nodes]:
        """Nodes of the coercive and of the interaction field, of one kind of domains after the other; a spread of 0
        gives one node."""
        if self.is_product:
            return self._nodes_of(self.kinds[0])
        parts = [(kind, *self._nodes_of(kind)) for kind in self.kinds]
        coercive = [(fields, kind.share * weights) for kind, (fields, weights), _ in parts]
        interaction = [
            (np.average(kind.widening(barriers[0]), weights=barriers[1]) * fields, kind.share * weights)
            for kind, barriers, (fields, weights) in parts
        ]
        return _after_one_another(coercive), _after_one_another(interaction)

    def tables(self, coercive: Nodes, interaction: Nodes) -> tuple[Array, Array, Array, Array]:
        """One row that holds every domain."""
        if self.is_product:
            barrier, field = (grid.ravel() for grid in np.meshgrid(coercive[0], interaction[0], indexing="ij"))
            weight = np.outer(coercive[1], interaction[1]).ravel()
        else:
            barrier, field, weight = self._domains
        return barrier - field, -barrier - field, np.ones(1), weight

    def interaction_fields(self, coercive: Nodes, interaction: Nodes) -> Array:
        """Of every domain [V/m]."""
        return super().interaction_fields(coercive, interaction) if self.is_product else self._domains[1]

    @cached_property
    def _domains(self) -> tuple[Array, Array, Array]:
        """Coercive and interaction field [V/m] and weight [-] of each, where these are no product."""
        parts = []
        for kind in self.kinds:
            coercive, interaction = self._nodes_of(kind)
            fields = np.outer(kind.widening(coercive[0]), interaction[0])
            barriers = np.broadcast_to(coercive[0][:, None], fields.shape)
            weights = kind.share * np.outer(coercive[1], interaction[1])
            parts.append((barriers.ravel(), fields.ravel(), weights.ravel()))
        barrier, field, weight = (np.concatenate(each) for each in zip(*parts, strict=True))
        return barrier, field, weight

    def _nodes_of(self, kind: Kind) -> tuple[Nodes, Nodes]:
        """Of a kind of domains, its interaction fields those at its reference."""
        above = self._count("nodes_coercive_above")
        below = self._count("nodes_coercive_below")
        side = self._count("nodes_interaction_side")
        if self.rule == "thesis":
            coercive = gauss_legendre(kind.coercive, below, above)
            interaction = gauss_legendre(kind.interaction, side, side)
        else:
            coercive = equal_probability(kind.coercive, below + above)
            interaction = equal_probability(kind.interaction, 2 * side)
        return self._normalized(coercive, kind.coercive), self._normalized(interaction, kind.interaction)

    def _normalized(self, nodes: Nodes, density: Density) -> Nodes:
        fields, weights = nodes
        if self.normalization == "exact":
            return fields, weights / weights.sum()
        return fields, weights * (thesis_constant(density) if self.rule == "thesis" else 1.0)

    def _count(self, name: str) -> int:
        value = getattr(self, name)
        if value != int(value):
            raise BenchError(f"{self.kind}.{name}: {value:g} is not a whole number; give one")
        return int(value)


def _after_one_another(nodes: Sequence[Nodes]) -> Nodes:
    fields, weights = zip(*nodes, strict=True)
    return np.concatenate(fields), np.concatenate(weights)
