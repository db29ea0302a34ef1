"""The polycrystal as two switching fronts and an Everett table: quadrature's physics at the price of one ODE."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import front_kernel as kernel
from pzt_ros.physics.density import Density, Gaussian, Table
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.front_kinetics import front_table
from pzt_ros.physics.front_shares import Fronts
from pzt_ros.physics.front_tables import everett
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.link import State
from pzt_ros.physics.polycrystal import FIELD_LIMIT, INVERSE_TOLERANCE, QUASI_STATIC_RATE
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_shared_table = lru_cache(maxsize=1)(front_table)


@dataclass(frozen=True, kw_only=True)
class Front(Ferroelectric):
    """Voltage to polarization of the polycrystal of `quadrature` and `lattice`, with their parameters (3.2).

    Instead of many domains it moves the two fronts, up and down, at which domains are switching, and reads from an
    Everett table how many they have passed; turning points of the fronts are its memory, 256 nested loops of it (a loop
    nested deeper makes it forget the innermost). It differs from a fine lattice by 0.01 to 0.03 % of x+ rms from 0.1 to
    100 MV/m/s (methods.md 3, docs of front_kinetics), also in holds, where the parametrized model fails.

    State: see front_kernel. Limits: a jump of 1 MV/m is followed late for about tau (x+ up to 9 % off within it, 0.1 %
    after it); barriers of about d, where domains flip to and fro, cost 0.2 %, no interaction fields 0.5 %; at most one
    of the spreads may be 0.

    Attributes:
        coercive_density, interaction_density: in place of the Gaussians, a table each.
    """

    kind: ClassVar[str] = "front"

    coercive_field: float = parameter(
        0.5e6, "V/m", "where the coercive fields are densest", symbol="E_c", bounds=(0.0, 1e7)
    )
    coercive_field_spread: float = parameter(
        5e11,
        "V^2/m^2",
        "b1 = 2 sigma^2 of the coercive fields; 0: as narrow as the table allows",
        symbol="b_1",
        bounds=(0.0, 1e14),
    )
    interaction_field_spread: float = parameter(
        5e11,
        "V^2/m^2",
        "b2 = 2 sigma^2 of the interaction fields; 0: as narrow as the table allows",
        symbol="b_2",
        bounds=(0.0, 1e14),
    )
    relaxation_time: float = parameter(
        1e-3, "s", "of thermally activated switching", symbol="tau_x", bounds=(1e-9, 1e6)
    )
    domain_polarization: float = parameter(0.26, "C/m^2", "of a domain at zero field", symbol="P_T", bounds=(0.0, 2.0))
    reciprocal_permittivity: float = parameter(6e7, "V*m/C", "dE/dP of a domain", symbol="E_1", bounds=(1e5, 1e10))
    temperature: float = parameter(293.0, "K", "of the ceramic", symbol="T", bounds=(1.0, 1000.0))
    domain_volume: float = parameter(1e-22, "m^3", "that switches at once", symbol="V_D", bounds=(1e-27, 1e-18))
    dead_band: float = parameter(
        1.0,
        "1",
        "thermal widths d by which a front falls behind before the field has turned; keeps noise out of memory",
        bounds=(0.01, 10.0),
    )
    accuracy: float = parameter(
        1e-6, "1", "as of the lattice; above 1e-4 long ramps are divided less", bounds=(1e-12, 1e-2)
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

    @cached_property
    def fronts(self) -> Fronts:
        """What the compiled loops need."""
        table, width = everett(self.coercive, self.interaction), self.thermal_width
        return Fronts(
            table=_shared_table(),
            shares=table.values,
            per=width / table.step,
            initial=table.initial,
            per_volt=1.0 / (self.layer_thickness * width),
            attempt_rate=1.0 / self.relaxation_time,
            least_slope=1.0 / (self.reciprocal_permittivity * self.layer_thickness),
            domain_polarization=self.domain_polarization,
            bias=table.mean / self.reciprocal_permittivity,
            layer_thickness=self.layer_thickness,
            dead_band=self.dead_band,
            field_step=0.25 if self.accuracy <= 1e-4 else 1.0,
        )

    def init(self, rest: Rest) -> State:
        """A virgin specimen (x+ = 0 where E_e < 0, else 1), brought slowly from 0 to the voltage at rest."""
        state = kernel.virgin(self.fronts, all_up=self.interaction.spread == 0)
        state[kernel.TIME] = rest.time
        if rest.voltage != 0:
            state[kernel.TIME] -= abs(rest.voltage) / self.layer_thickness / QUASI_STATIC_RATE
            self._run(state, np.array([rest.time]), np.array([rest.voltage]))
        return state

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage [V] to polarization [C/m^2] and phase fraction [-].

        Raises:
            BenchError: no voltage, a sample that is not finite, time that runs back, a foreign state.
        """
        self._check("voltage", signals.voltage, signals.time, state)
        after = state.copy()
        polarization, phase_fraction = self._run(after, signals.time, signals.voltage)
        return after, signals.replace(polarization=polarization, phase_fraction=phase_fraction)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization wanted [C/m^2] to the voltage [V] for which `step` gives it, within +-10 MV/m.

        A sample that asks for no finite polarization keeps the last voltage.

        Raises:
            BenchError: no polarization, time that runs back, a foreign state.
        """
        self._check("polarization", signals.polarization, signals.time, state)
        after = state.copy()
        voltage, phase_fraction = np.empty(signals.time.size), np.empty(signals.time.size)
        limit = FIELD_LIMIT * self.layer_thickness
        bad = kernel.run_inverse(
            after, self.fronts, signals.time, signals.polarization, voltage, phase_fraction, limit, INVERSE_TOLERANCE
        )
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: time {signals.time[bad]:.9g} s at sample {bad} is not after the one before; sort it"
            )
        return after, signals.replace(voltage=voltage, phase_fraction=phase_fraction)

    def _check(self, name: str, values: Array, time: Array, state: State) -> None:
        """The compiled loops do not look where they read."""
        if values.size != time.size:
            raise BenchError(
                f"{self.kind}: the block has {values.size} values of {name} for {time.size} times;"
                f" put a link or a record that gives {name} before this one"
            )
        if state.size != kernel.STATE_SIZE:
            raise BenchError(
                f"{self.kind}: the state has {state.size} numbers, this model has {kernel.STATE_SIZE};"
                " start from init()"
            )

    def _run(self, state: State, time: Array, voltage: Array) -> tuple[Array, Array]:
        polarization, phase_fraction = np.empty(time.size), np.empty(time.size)
        bad = kernel.run(state, self.fronts, time, voltage, polarization, phase_fraction)
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: sample {bad} ({time[bad]:.9g} s, {voltage[bad]:.6g} V) is not finite, beyond"
                " 1 GV/m, or not after the one before; drop or sort it"
            )
        return polarization, phase_fraction
