"""A polycrystal: many domains that differ in coercive and interaction field (thesis 3.2), as a link of the chain."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import polycrystal_kernel as kernel
from pzt_ros.physics.density import Density, Gaussian, Nodes, Table
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import choice, parameter

QUASI_STATIC_RATE = 1e5
"""[V/m/s]; the slowest ramp of the thesis' experiments."""

FIELD_LIMIT = 1e7
"""The inverse looks for fields up to this [V/m]; a PZT layer breaks down before."""

INVERSE_TOLERANCE = 1e-10
"""Polarization by which the inverse may miss [C/m^2]."""

METHODS = {"collocation": kernel.COLLOCATION, "midpoint": kernel.MIDPOINT}


@dataclass(frozen=True, kw_only=True)
class Polycrystal(Ferroelectric):
    """What quadrature and lattice share; they differ in where they put their domains.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then x+ of every domain [-].

    Attributes:
        coercive_density, interaction_density: in place of the Gaussians, a table each.
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
    relaxation_time: float = parameter(
        1e-3, "s", "of thermally activated switching", symbol="tau_x", bounds=(1e-9, 1e6)
    )
    domain_polarization: float = parameter(0.26, "C/m^2", "of a domain at zero field", symbol="P_T", bounds=(0.0, 2.0))
    reciprocal_permittivity: float = parameter(6e7, "V*m/C", "dE/dP of a domain", symbol="E_1", bounds=(1e5, 1e10))
    temperature: float = parameter(293.0, "K", "of the ceramic", symbol="T", bounds=(1.0, 1000.0))
    domain_volume: float = parameter(1e-22, "m^3", "that switches at once", symbol="V_D", bounds=(1e-27, 1e-18))
    accuracy: float = parameter(1e-6, "1", "largest error of the integration in x+", symbol="", bounds=(1e-12, 1e-2))
    method: str = choice(
        "collocation",
        tuple(METHODS),
        "collocation: order 4, at any rate; midpoint: order 2, for small steps in real time",
    )
    coercive_density: Table | None = None
    interaction_density: Table | None = None

    def __post_init__(self) -> None:
        table = self.coercive_density
        if table is not None and table.field[0] < 0:
            raise BenchError(
                f"{self.kind}: coercive field of {table.field[0]:.6g} V/m in the density table; barriers start at 0"
            )

    @property
    def coercive(self) -> Density:
        """Density of the coercive field; none lies below 0 (3.12)."""
        return self.coercive_density or Gaussian(self.coercive_field, self.coercive_field_spread, lower=0.0)

    @property
    def interaction(self) -> Density:
        """Density of the interaction field (3.14)."""
        return self.interaction_density or Gaussian(0.0, self.interaction_field_spread)

    @property
    def thermal_width(self) -> float:
        """d [V/m]."""
        return thermal_width(self.reciprocal_permittivity, self.temperature, self.domain_volume)

    @abstractmethod
    def nodes(self) -> tuple[Nodes, Nodes]:
        """Nodes of the coercive and of the interaction field, each (fields [V/m], weights [-])."""

    @abstractmethod
    def tables(self, coercive: Nodes, interaction: Nodes) -> tuple[Array, Array, Array, Array]:
        """Thresholds a and b [V/m] and the weights of rows and columns, as `polycrystal_kernel` wants them."""

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

    def init(self, rest: Rest) -> State:
        """A virgin specimen (x+ = 0 where E_e < 0, else 1), brought slowly from 0 to the voltage at rest."""
        coercive, interaction = self.nodes()
        virgin = np.tile(np.where(interaction[0] < 0, 0.0, 1.0), coercive[0].size)
        elements = self.elements
        weight = elements.row_weight.sum() * elements.column_weight.sum()
        slope = weight * elements.susceptibility / self.layer_thickness
        if rest.voltage == 0:
            return np.concatenate(([rest.time, 0.0, slope], virgin))
        duration = abs(rest.voltage) / self.layer_thickness / QUASI_STATIC_RATE
        state = np.concatenate(([rest.time - duration, 0.0, slope], virgin))
        self._run(state, np.array([rest.time]), np.array([rest.voltage]))
        return state

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage [V] to polarization [C/m^2] and phase fraction [-].

        Raises:
            BenchError: no voltage, a sample that is not finite, time that runs back, a foreign state.
        """
        self._check_size("voltage", signals.voltage, signals.time)
        after = self._own(state)
        polarization, phase_fraction = self._run(after, signals.time, signals.voltage)
        return after, signals.replace(polarization=polarization, phase_fraction=phase_fraction)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization wanted [C/m^2] to the voltage [V] for which `step` gives it, within +-10 MV/m.

        A sample that asks for no finite polarization keeps the last voltage.

        Raises:
            BenchError: no polarization, time that runs back, a foreign state.
        """
        self._check_size("polarization", signals.polarization, signals.time)
        after = self._own(state)
        voltage, phase_fraction = np.empty(signals.time.size), np.empty(signals.time.size)
        limit = FIELD_LIMIT * self.layer_thickness
        bad = kernel.run_inverse(
            after, self.elements, signals.time, signals.polarization, voltage, phase_fraction, limit, INVERSE_TOLERANCE
        )
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: time {signals.time[bad]:.9g} s at sample {bad} is not after the one before; sort it"
            )
        return after, signals.replace(voltage=voltage, phase_fraction=phase_fraction)

    def _check_size(self, name: str, values: Array, time: Array) -> None:
        """The compiled loops do not look where they read."""
        if values.size != time.size:
            raise BenchError(
                f"{self.kind}: the block has {values.size} values of {name} for {time.size} times;"
                f" put a link or a record that gives {name} before this one"
            )

    def _own(self, state: State) -> State:
        """A copy of a state that fits this link."""
        elements = self.elements
        size = kernel.HEAD + elements.row_weight.size * elements.column_weight.size
        if state.size != size:
            raise BenchError(
                f"{self.kind}: the state has {state.size} numbers, this model has {size}; start from init()"
            )
        return state.copy()

    def _run(self, state: State, time: Array, voltage: Array) -> tuple[Array, Array]:
        polarization, phase_fraction = np.empty(time.size), np.empty(time.size)
        bad = kernel.run(state, self.elements, time, voltage, polarization, phase_fraction)
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: sample {bad} ({time[bad]:.9g} s, {voltage[bad]:.6g} V) is not finite, beyond"
                " 1 GV/m, or not after the one before; drop or sort it"
            )
        return polarization, phase_fraction
