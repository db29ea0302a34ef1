"""The polycrystal on a lattice: one spacing for both fields lets domains share their rates (methods.md 1.3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Nodes, ThresholdDensity, equally_spaced
from pzt_ros.physics.polycrystal import Polycrystal
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter

_MAX_DOMAINS = 4_000_000
_PLACES = 4  # in each direction, at which an identified density is taken for a domain


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
        """Distance of neighbouring domains, E_c or E_e [V/m]; at most half a standard deviation, or a quarter of an
        identified grid."""
        widest = self.spacing * self.thermal_width
        if self.threshold_density is not None:
            return min(widest, self.threshold_density.spacing / 4)
        densities = [density for kind in self.kinds for density in (kind.coercive, kind.interaction)]
        return min([widest, *(math.sqrt(d.spread / 2) / 2 for d in densities if d.spread > 0)])

    @property
    def domains(self) -> float:
        """How many of them Gaussians or their like ask for, of one kind or two."""
        (first, highest), (low, high) = self._ends
        return max((highest - first) / self.field_spacing, 1.0) * max((high - low) / self.field_spacing, 1.0)

    @property
    def _ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Lowest and highest coercive, and interaction field of all kinds [V/m]."""
        ends = np.array([kind.ends(self.cut) for kind in self.kinds])
        lowest, highest = ends.min(axis=0), ends.max(axis=0)
        return (float(lowest[0]), float(highest[1])), (float(lowest[2]), float(highest[3]))

    def nodes(self) -> tuple[Nodes, Nodes]:
        """Nodes of the coercive and of the interaction field; a spread of 0 gives one node.

        Raises:
            BenchError: more domains than fit into memory with good reason.
        """
        if self._joint is not None:
            coercive, interaction, weights = self._joint
            return (coercive, weights.sum(axis=1)), (interaction, weights.sum(axis=0))
        step = self.field_spacing
        self._check_count(self.domains)
        return (
            _normalized(equally_spaced(self.coercive, step, self.cut)),
            _normalized(equally_spaced(self.interaction, step, self.cut)),
        )

    def tables(self, coercive: Nodes, interaction: Nodes) -> tuple[Array, Array, Array, Array]:
        """A row per coercive field, a column per interaction field."""
        steps = self.field_spacing * np.arange(coercive[0].size + interaction[0].size - 1)
        forward = coercive[0][-1] - interaction[0][0] - steps
        backward = -coercive[0][0] - interaction[0][0] - steps
        if self._joint is not None:
            return forward, backward, np.ones(coercive[0].size), self._joint[2].ravel()
        return forward, backward, coercive[1], interaction[1]

    @cached_property
    def _joint(self) -> tuple[Array, Array, Array] | None:
        """Coercive fields, interaction fields [V/m] and the weights of all pairs [-], where no product gives these."""
        if self.threshold_density is not None:
            return self._identified(self.threshold_density)
        return None if self.is_product else self._of_kinds()

    def _of_kinds(self) -> tuple[Array, Array, Array]:
        """The same of kinds of domains, each pair with what lies within half a step of it."""
        step = self.field_spacing
        self._check_count(self.domains)
        coercive, interaction = (_middles(low, high, step) for low, high in self._ends)
        parts = [kind.widened(step / 2).shares(coercive, interaction, step) for kind in self.kinds]
        return coercive, interaction, np.sum(parts, axis=0)

    def _identified(self, density: ThresholdDensity) -> tuple[Array, Array, Array]:
        """Coercive fields, interaction fields [V/m] and the weights of all pairs [-]; domains lie half a step off 0."""
        step = self.field_spacing
        highest = (density.up_fields[-1] - density.down_fields[0]) / 2
        low = -(density.up_fields[-1] + min(density.down_fields[-1], density.up_fields[-1])) / 2
        high = -(max(density.up_fields[0], density.down_fields[0]) + density.down_fields[0]) / 2
        self._check_count(highest * (high - low) / step**2)
        coercive, interaction = _middles(0.0, highest, step), _middles(low, high, step)
        weights = np.zeros((coercive.size, interaction.size))
        places = step * ((np.arange(_PLACES) + 0.5) / _PLACES - 0.5)
        for c in places:  # the mean over what a domain stands for: an identified density may end with a jump
            for e in places:
                barrier, bias = coercive[:, None] + c, interaction + e
                weights += density.at(barrier - bias, -barrier - bias)
        return coercive, interaction, weights / weights.sum()

    def _check_count(self, domains: float) -> None:
        if domains > _MAX_DOMAINS:
            raise BenchError(
                f"lattice: {domains:.3g} domains {self.field_spacing:.3g} V/m apart, at most {_MAX_DOMAINS:.3g} are"
                " wise; raise the spacing, or set a spread far below the thermal width to 0"
            )


def _middles(low: float, high: float, step: float) -> Array:
    """Of classes from a whole multiple of the step on [V/m]."""
    first = math.floor(low / step)
    return (np.arange(first, max(math.ceil(high / step), first + 1), dtype=np.float64) + 0.5) * step


def _normalized(nodes: Nodes) -> Nodes:
    fields, weights = nodes
    return fields, weights / weights.sum()
