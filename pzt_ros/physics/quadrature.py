"""The polycrystal by quadrature (thesis 3.2.2): few, freely placed domains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Nodes, equal_probability, gauss_legendre, thesis_constant
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
        """Nodes of the coercive and of the interaction field; a spread of 0 gives one node."""
        above = self._count("nodes_coercive_above")
        below = self._count("nodes_coercive_below")
        side = self._count("nodes_interaction_side")
        if self.rule == "thesis":
            coercive = gauss_legendre(self.coercive, below, above)
            interaction = gauss_legendre(self.interaction, side, side)
        else:
            coercive = equal_probability(self.coercive, below + above)
            interaction = equal_probability(self.interaction, 2 * side)
        return self._normalized(coercive, True), self._normalized(interaction, False)

    def tables(self, coercive: Nodes, interaction: Nodes) -> tuple[Array, Array, Array, Array]:
        """One row that holds every domain."""
        coercive_field, interaction_field = np.meshgrid(coercive[0], interaction[0], indexing="ij")
        weight = np.outer(coercive[1], interaction[1]).ravel()
        forward, backward = coercive_field - interaction_field, -coercive_field - interaction_field
        return forward.ravel(), backward.ravel(), np.ones(1), weight

    def _normalized(self, nodes: Nodes, coercive: bool) -> Nodes:
        fields, weights = nodes
        if self.normalization == "exact":
            return fields, weights / weights.sum()
        factor = thesis_constant(self.coercive if coercive else self.interaction) if self.rule == "thesis" else 1.0
        return fields, weights * factor

    def _count(self, name: str) -> int:
        value = getattr(self, name)
        if value != int(value):
            raise BenchError(f"{self.kind}.{name}: {value:g} is not a whole number; give one")
        return int(value)
