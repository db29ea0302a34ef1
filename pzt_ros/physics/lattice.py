"""The polycrystal on a lattice: one spacing for both fields lets domains share their rates (methods.md 1.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Nodes, equally_spaced
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter

_MAX_DOMAINS = 4_000_000


@dataclass(frozen=True, kw_only=True)
class Lattice(Polycrystal):
    """Polarization as a sum over equally spaced domains: the reference among the models, and in real time.

    Thermal activation smooths over d, so d sets the spacing: 0.5 d gives x+ to 1e-5, d to 3e-4.
    """

    kind: ClassVar[str] = "lattice"

    spacing: float = parameter(0.5, "1", "distance of domains over thermal width d", symbol="D/d", bounds=(0.01, 10.0))
    cut: float = parameter(4.5, "1", "standard deviations kept of each Gaussian", bounds=(1.0, 8.0))

    @property
    def field_spacing(self) -> float:
        """Distance of neighbouring domains, E_c or E_e [V/m]; at most half a standard deviation."""
        sigmas = [math.sqrt(d.spread / 2) for d in (self.coercive, self.interaction) if d.spread > 0]
        return min([self.spacing * self.thermal_width, *(sigma / 2 for sigma in sigmas)])

    def nodes(self) -> tuple[Nodes, Nodes]:
        """Nodes of the coercive and of the interaction field; a spread of 0 gives one node.

        Raises:
            BenchError: more domains than fit into memory with good reason.
        """
        step = self.field_spacing
        ends = [density.support(self.cut) for density in (self.coercive, self.interaction) if density.spread > 0]
        domains = math.prod((high - low) / step for low, high in ends)
        if domains > _MAX_DOMAINS:
            raise BenchError(
                f"lattice: {domains:.3g} domains {step:.3g} V/m apart, at most {_MAX_DOMAINS:.3g} are wise;"
                " raise the spacing, or set a spread far below the thermal width to 0"
            )
        coercive = equally_spaced(self.coercive, step, self.cut)
        interaction = equally_spaced(self.interaction, step, self.cut)
        return _normalized(coercive), _normalized(interaction)

    def tables(self, coercive: Nodes, interaction: Nodes) -> tuple[Array, Array, Array, Array]:
        """A row per coercive field, a column per interaction field."""
        steps = self.field_spacing * np.arange(coercive[0].size + interaction[0].size - 1)
        forward = coercive[0][-1] - interaction[0][0] - steps
        backward = -coercive[0][0] - interaction[0][0] - steps
        return forward, backward, coercive[1], interaction[1]


def _normalized(nodes: Nodes) -> Nodes:
    fields, weights = nodes
    return fields, weights / weights.sum()
