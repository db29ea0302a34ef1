"""The parametrized ferroelectric with one distribution: of coercive fields or of interaction fields (3.3.1, 3.3.2)."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pzt_ros.physics import parametrized_single_branch as branch
from pzt_ros.physics import parametrized_single_kernel as kernel
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.link import State
from pzt_ros.physics.one_equation import OneEquation, decaying_drive
from pzt_ros.physics.signals import Rest
from pzt_ros.quantities import choice, parameter

_PRERUN_SAMPLES = 20_001

_DISTRIBUTIONS = {
    "coercive": branch.COERCIVE,
    "coercive_without_history": branch.COERCIVE_WITHOUT_HISTORY,
    "interaction": branch.INTERACTION,
}


@dataclass(frozen=True, kw_only=True)
class ParametrizedSingle(OneEquation):
    """Voltage to polarization by one ODE whose barrier follows what has switched, along one distribution.

    coercive: the barrier starts from 0 where the field passes 0 and rises to E_c(x+) (3.23); x+ at these points is
        remembered, 256 nested loops of it. Domains switch in the direction of the field only.
    coercive_without_history: the model of chapter 4, E_c(x+) upwards and E_c(1 - x+) downwards; smooth.
    interaction: E_c - E_e(x+) upwards and -E_c - E_e(x+) downwards (3.31); smooth, and there is nothing to remember.

    No special case of `parametrized`, whose barrier goes on at a reversal where it was.
    """

    kind: ClassVar[str] = "parametrized_single"
    _kernel: ClassVar[Any] = kernel
    _inverse: ClassVar[Any] = kernel

    distribution: str = choice("coercive", tuple(_DISTRIBUTIONS), "What is distributed over the domains.")
    coercive_field: float = parameter(
        0.5e6,
        "V/m",
        "Where the coercive fields are densest, or the one there is.",
        symbol="E_c",
        bounds=(0.0, 1e7),
    )
    spread: float = parameter(
        1e11,
        "V^2/m^2",
        "b = 2 sigma^2 of the one distribution.",
        symbol="b",
        bounds=(1e6, 1e14),
    )
    relaxation_time: float = parameter(
        1e-3,
        "s",
        "Time constant of switching at zero barrier.",
        symbol="tau",
        bounds=(1e-9, 1e6),
    )
    domain_polarization: float = parameter(
        0.26,
        "C/m^2",
        "Polarization of a switched domain at zero field.",
        symbol="P_T",
        bounds=(1e-6, 10.0),
    )
    reciprocal_permittivity: float = parameter(
        6e7,
        "V*m/C",
        "Field per polarization within a domain.",
        symbol="E_1",
        bounds=(1e4, 1e12),
    )
    start: str = choice(
        "virgin",
        ("virgin", "negative", "positive"),
        "State before the run: x+ = 0.5 (with history: after the thesis' decaying drive), or saturated.",
    )
    virgin_amplitude: float = parameter(
        2e6,
        "V/m",
        "Amplitude A of the pre-run A sin(20 pi t)(1 - t), 0 to 1 s; with history only.",
        symbol="A",
        bounds=(0.0, 1e7),
    )

    @functools.cached_property
    def material(self) -> branch.Material:
        """The numbers as the compiled kernel takes them."""
        slope, distribution = math.sqrt(self.spread), _DISTRIBUTIONS[self.distribution]
        clipped = distribution != branch.INTERACTION  # there are no coercive fields below 0
        lowest = -self.coercive_field / slope
        return branch.Material(
            distribution=distribution,
            centre=float(self.coercive_field),
            slope=slope,
            below=math.erfc(-lowest) if clipped else 0.0,
            lowest=max(lowest, -branch.HARDEST) if clipped else -branch.HARDEST,
            thermal_width=thermal_width(self.reciprocal_permittivity, self.temperature, self.domain_volume),
            relaxation_time=float(self.relaxation_time),
            domain_polarization=float(self.domain_polarization),
            reciprocal_permittivity=float(self.reciprocal_permittivity),
            layer_thickness=float(self.layer_thickness),
            accuracy=float(self.accuracy),
        )

    def init(self, rest: Rest) -> State:
        """The state before the run and, if the rest voltage is not 0, a ramp to it within 1 s."""
        state = _before(self).copy()
        self._ramp_to(state, rest.voltage)
        state[branch.TIME] = rest.time
        return state


@functools.lru_cache(maxsize=64)
def _before(link: ParametrizedSingle) -> State:
    """State before the run; read-only, since it is shared."""
    if link.start == "virgin" and link.distribution != "coercive":
        state = branch.fresh_state(link.material, 0.5)
    else:
        state = branch.fresh_state(link.material, 1.0 if link.start == "positive" else 0.0)
    if link.start == "virgin" and link.distribution == "coercive":
        time, voltage = decaying_drive(link.virgin_amplitude, link.layer_thickness, _PRERUN_SAMPLES)
        kernel.run(state, tuple(link.material), time, voltage, np.empty_like(time), np.empty_like(time))
        state[branch.FIELD] = 0.0  # the drive ends at 0 to rounding
        branch.refresh(state, link.material)
    state.flags.writeable = False
    return state
