"""The polycrystal as two switching fronts and an Everett table: quadrature's physics at the price of one ODE."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

from pzt_ros.physics import front_kernel as kernel
from pzt_ros.physics import front_memory as memory
from pzt_ros.physics.domains import Domains
from pzt_ros.physics.front_kinetics import front_table
from pzt_ros.physics.front_shares import Fronts
from pzt_ros.physics.front_tables import everett
from pzt_ros.physics.front_thresholds import everett_of
from pzt_ros.physics.link import State
from pzt_ros.quantities import parameter

_NEAREST = 0.2
"""Thermal widths between loops that count as one; with dozens of them x+ is up to 3e-5 off, in long steps 8e-5."""

_shared_table = lru_cache(maxsize=1)(front_table)


@dataclass(frozen=True, kw_only=True)
class Front(Domains):
    """Voltage to polarization of the polycrystal of `quadrature` and `lattice`, with their parameters (3.2).

    Instead of many domains it moves the two fronts, up and down, at which domains are switching, and reads from an
    Everett table how many they have passed; turning points of the fronts are its memory, 256 nested loops of it (a loop
    nested deeper makes it forget the innermost). It differs from a fine lattice by 0.01 to 0.03 % of x+ rms from 0.1 to
    100 MV/m/s (methods.md 3, docs of front_kinetics), also in holds, where the parametrized model fails.

    State: see front_memory. Limits: a jump of 1 MV/m is followed late for about tau (x+ up to 9 % off within it, 0.1 %
    after it); barriers of about d, where domains flip to and fro, cost 0.2 %, no interaction fields 0.5 %; spreads
    of 0 are as narrow as the table allows, and at most one may be 0.
    """

    kind: ClassVar[str] = "front"
    _kernel: ClassVar[Any] = kernel

    dead_band: float = parameter(
        1.0,
        "1",
        "thermal widths d by which a front falls behind before the field has turned; keeps noise out of memory",
        bounds=(0.01, 10.0),
    )
    accuracy: float = parameter(
        1e-6,
        "1",
        "as of the lattice; above 1e-5 loops that nearly coincide are one, above 1e-4 long ramps are divided less",
        bounds=(1e-12, 1e-2),
    )

    @cached_property
    def fronts(self) -> Fronts:
        """What the compiled loops need."""
        identified, width = self.threshold_density, self.thermal_width
        table = everett_of(identified) if identified else everett(self.kinds)
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
            nearest=_NEAREST if self.accuracy > 1e-5 else 0.0,
        )

    def _virgin(self) -> State:
        is_even = self.threshold_density is None and all(kind.interaction.spread == 0 for kind in self.kinds)
        return memory.virgin(self.fronts, all_up=is_even)

    @property
    def _state_size(self) -> int:
        return memory.STATE_SIZE

    @property
    def _numbers(self) -> Any:
        return self.fronts
