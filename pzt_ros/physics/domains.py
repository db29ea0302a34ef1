"""A ceramic of many domains that differ in coercive and interaction field (thesis 3.2): what all its models share."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.density import Bent, Density, Gaussian, Table, ThresholdDensity
from pzt_ros.physics.density_data import table_from_data, table_to_data, thresholds_from_data, thresholds_to_data
from pzt_ros.physics.kinds import Kind
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Rest
from pzt_ros.physics.switching import QUASI_STATIC_RATE, Switching
from pzt_ros.quantities import form, parameter

_LEAST_FIELD = 1.0  # [V/m]


@dataclass(frozen=True, kw_only=True)
class Domains(Switching):
    """Voltage to polarization; the models differ in what they remember of the domains.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then the model's own.

    Attributes:
        coercive_density, interaction_density: in place of the Gaussians, a table each.
        threshold_density: in place of both, as it was identified.
    """

    coercive_field: float = parameter(
        0.5e6, "V/m", "where the coercive fields are densest", symbol="E_c", bounds=(0.0, 1e7)
    )
    coercive_field_spread: float = parameter(
        5e11, "V^2/m^2", "b1 = 2 sigma^2 of the coercive fields; 0: one field", symbol="b_1", bounds=(0.0, 1e14)
    )
    interaction_field_spread: float = parameter(
        5e11, "V^2/m^2", "b2 = 2 sigma^2 of the interaction fields; 0: none", symbol="b_2", bounds=(0.0, 1e14)
    )
    coercive_field_skew: float = parameter(
        0.0, "1", "of the coercive fields, towards a lognormal density; 0: Gaussian", symbol="s", bounds=(-1.0, 1.5)
    )
    coercive_field_tail: float = parameter(
        0.0, "1", "of the coercive fields: 0.25 about logistic, below 0 flatter than a Gaussian", bounds=(-1.0, 2.0)
    )
    interaction_field_tail: float = parameter(
        0.0, "1", "of the interaction fields: 0.25 about logistic, below 0 flatter than a Gaussian", bounds=(-1.0, 2.0)
    )
    interaction_field_skew: float = parameter(
        0.0, "1", "s: the interaction fields are 1 + s times as wide above 0, 1 - s below; 0: even", bounds=(-0.8, 0.8)
    )
    interaction_field_growth: float = parameter(
        0.0, "1", "k: at E_c interaction fields are 1 + k (E_c/coercive_field - 1) times as wide", bounds=(-1.0, 2.0)
    )
    second_share: float = parameter(0.0, "1", "of the domains that are of a second kind", bounds=(0.0, 0.95))
    second_coercive_field: float = parameter(
        1e6, "V/m", "where the coercive fields of the second kind are densest", bounds=(0.0, 1e7)
    )
    second_coercive_field_spread: float = parameter(
        5e11, "V^2/m^2", "2 sigma^2 of the coercive fields of the second kind", bounds=(0.0, 1e14)
    )
    second_interaction_field_spread: float = parameter(
        5e11, "V^2/m^2", "2 sigma^2 of the interaction fields of the second kind", bounds=(0.0, 1e14)
    )
    relaxation_time: float = parameter(
        1e-3, "s", "of thermally activated switching", symbol="tau_x", bounds=(1e-9, 1e6)
    )
    domain_polarization: float = parameter(0.26, "C/m^2", "of a domain at zero field", symbol="P_T", bounds=(0.0, 2.0))
    reciprocal_permittivity: float = parameter(6e7, "V*m/C", "dE/dP of a domain", symbol="E_1", bounds=(1e5, 1e10))
    temperature: float = parameter(293.0, "K", "of the ceramic", symbol="T", bounds=(1.0, 1000.0))
    domain_volume: float = parameter(1e-22, "m^3", "that switches at once", symbol="V_D", bounds=(1e-27, 1e-18))
    accuracy: float = parameter(1e-6, "1", "largest error of the integration in x+", bounds=(1e-12, 1e-2))
    coercive_density: Table | None = form(
        table_from_data, table_to_data, "of coercive fields, as a table in place of the Gaussian"
    )
    interaction_density: Table | None = form(
        table_from_data, table_to_data, "of interaction fields, as a table in place of the Gaussian"
    )
    threshold_density: ThresholdDensity | None = form(
        thresholds_from_data, thresholds_to_data, "identified, over switching fields, in place of both"
    )

    def __post_init__(self) -> None:
        if self.threshold_density is not None and (self.coercive_density or self.interaction_density):
            raise BenchError(
                f"{self.kind}: threshold_density stands for both fields; drop coercive_density and interaction_density"
            )
        table = self.coercive_density
        if table is not None and table.field[0] < 0:
            raise BenchError(
                f"{self.kind}: coercive field of {table.field[0]:.6g} V/m in the density table; barriers start at 0"
            )

    @property
    def coercive(self) -> Density:
        """Density of the coercive field; none lies below 0 (3.12)."""
        if self.coercive_density:
            return self.coercive_density
        field, spread = self.coercive_field, self.coercive_field_spread
        skew, tail = self.coercive_field_skew, self.coercive_field_tail
        is_bent = bool(spread and (skew or tail))
        return Bent(field, spread, lower=0.0, skew=skew, tail=tail) if is_bent else Gaussian(field, spread, lower=0.0)

    @property
    def interaction(self) -> Density:
        """Density of the interaction field (3.14)."""
        if self.interaction_density:
            return self.interaction_density
        spread, tail, skew = self.interaction_field_spread, self.interaction_field_tail, self.interaction_field_skew
        is_bent = bool(spread and (tail or skew))
        return Bent(0.0, spread, tail=tail, lopsided=skew) if is_bent else Gaussian(0.0, spread)

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """Of domains: one, or two."""
        reference = max(self.coercive_field, _LEAST_FIELD)
        first = Kind(1.0 - self.second_share, self.coercive, self.interaction, self.interaction_field_growth, reference)
        if not self.second_share:
            return (first,)
        coercive = Gaussian(self.second_coercive_field, self.second_coercive_field_spread, lower=0.0)
        return (first, Kind(self.second_share, coercive, Gaussian(0.0, self.second_interaction_field_spread)))

    @property
    def has_formula(self) -> bool:
        """Whether its densities are those of a formula, none of them a table."""
        return not (self.coercive_density or self.interaction_density or self.threshold_density)

    @property
    def is_product(self) -> bool:
        """Whether one density of each field, independent of the other, says all."""
        return self.threshold_density is None and len(self.kinds) == 1 and not self.interaction_field_growth

    @property
    def thermal_width(self) -> float:
        """d [V/m]."""
        return thermal_width(self.reciprocal_permittivity, self.temperature, self.domain_volume)

    @abstractmethod
    def _virgin(self) -> State:
        """The state of a virgin specimen at time 0 and 0 V: x+ = 0 where E_e < 0, else 1."""

    def init(self, rest: Rest) -> State:
        """A virgin specimen, brought slowly from 0 to the voltage at rest."""
        state = self._virgin()
        state[0] = rest.time - abs(rest.voltage) / self.layer_thickness / QUASI_STATIC_RATE
        if rest.voltage != 0:
            self._run(state, np.array([rest.time]), np.array([rest.voltage]))
        return state
