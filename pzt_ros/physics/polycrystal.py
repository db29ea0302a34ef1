"""A polycrystal: many domains that differ in coercive and interaction field (thesis 3.2), as a link of the chain."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pzt_ros.physics import polycrystal_kernel as kernel
from pzt_ros.physics.density import Nodes
from pzt_ros.physics.domains import Domains
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import choice

METHODS = {"collocation": kernel.COLLOCATION, "midpoint": kernel.MIDPOINT}


@dataclass(frozen=True, kw_only=True)
class Polycrystal(Domains):
    """What quadrature and lattice share; they differ in where they put their domains.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then x+ of every domain [-].
    """

    _kernel: ClassVar[Any] = kernel

    method: str = choice(
        "collocation",
        tuple(METHODS),
        "collocation: order 4, at any rate; midpoint: order 2, for small steps in real time",
    )

    @abstractmethod
    def nodes(self) -> tuple[Nodes, Nodes]:
        """Nodes of the coercive and of the interaction field, each (fields [V/m], weights [-]): marginal densities."""

    @abstractmethod
    def tables(self, coercive: Nodes, interaction: Nodes) -> tuple[Array, Array, Array, Array]:
        """Thresholds a and b [V/m] and the weights of rows and columns, as `polycrystal_kernel` wants them."""

    def interaction_fields(self, coercive: Nodes, interaction: Nodes) -> Array:
        """Of every domain, a row of the tables after the other [V/m]."""
        return np.tile(interaction[0], coercive[0].size)

    @cached_property
    def elements(self) -> kernel.Elements:
        """What the compiled loops need."""
        coercive, interaction = self.nodes()
        forward, backward, row_weight, column_weight = self.tables(coercive, interaction)
        field_sum = float(np.dot(interaction[1], interaction[0]) * coercive[1].sum())
        width, method = self.thermal_width, METHODS[self.method]
        return kernel.Elements(
            forward=forward / width,
            backward=backward / width,
            row_weight=row_weight,
            column_weight=column_weight,
            width=width,
            attempt_rate=1.0 / self.relaxation_time,
            susceptibility=1.0 / self.reciprocal_permittivity,
            domain_polarization=self.domain_polarization,
            bias=field_sum / self.reciprocal_permittivity,
            layer_thickness=self.layer_thickness,
            method=method,
            field_step=kernel.field_step(method, self.accuracy),
        )

    def _virgin(self) -> State:
        coercive, interaction = self.nodes()
        x = np.where(self.interaction_fields(coercive, interaction) < 0, 0.0, 1.0)
        slope = coercive[1].sum() * interaction[1].sum() * self.elements.susceptibility / self.layer_thickness
        return np.concatenate(([0.0, 0.0, slope], x))

    @property
    def _state_size(self) -> int:
        rows = self.elements.row_weight.size
        return kernel.HEAD + rows * (self.elements.forward.size - rows + 1)

    @property
    def _numbers(self) -> Any:
        return self.elements
