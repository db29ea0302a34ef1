"""The parametrized ferroelectric with one distribution: of coercive fields or of interaction fields (3.3.1, 3.3.2)."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import parametrized_single_branch as branch
from pzt_ros.physics import parametrized_single_kernel as kernel
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import choice, parameter

_PRERUN_SAMPLES = 20_001
_RAMP_TO_REST = 1.0

_DISTRIBUTIONS = {
    "coercive": branch.COERCIVE,
    "coercive_without_history": branch.COERCIVE_WITHOUT_HISTORY,
    "interaction": branch.INTERACTION,
}


@dataclass(frozen=True, kw_only=True)
class ParametrizedSingle(Ferroelectric):
    """Voltage to polarization by one ODE whose barrier follows what has switched, along one distribution.

    coercive: the barrier starts from 0 where the field passes 0 and rises to E_c(x+) (3.23); x+ at these points is
        remembered, 256 nested loops of it. Domains switch in the direction of the field only.
    coercive_without_history: the model of chapter 4, E_c(x+) upwards and E_c(1 - x+) downwards; smooth.
    interaction: E_c - E_e(x+) upwards and -E_c - E_e(x+) downwards (3.31); smooth, and there is nothing to remember.

    No special case of `parametrized`, whose barrier goes on at a reversal where it was.
    """

    kind: ClassVar[str] = "parametrized_single"

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
    temperature: float = parameter(
        293.0,
        "K",
        "Temperature of thermal activation.",
        symbol="T",
        bounds=(1.0, 2000.0),
    )
    domain_volume: float = parameter(
        1e-22,
        "m^3",
        "Volume that switches at once.",
        symbol="V_D",
        bounds=(1e-27, 1e-15),
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
    accuracy: float = parameter(
        1e-6,
        "1",
        "Local error of the phase fraction allowed per step of the integration.",
        bounds=(1e-12, 1e-2),
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
        if rest.voltage != 0.0:
            end = state[branch.TIME] + _RAMP_TO_REST
            self._run(state, np.array([end]), np.array([float(rest.voltage)]))
        state[branch.TIME] = rest.time
        return state

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization and phase fraction at the samples; the field is linear between them, however far apart.

        A sample at the time of the last one is a jump of the field.

        Raises:
            BenchError: a time or voltage is missing or no finite number.
        """
        time, after = _finite(signals.time, signals.time.size, "time", "s"), state.copy()
        p, x = self._run(after, time, _finite(signals.voltage, time.size, "voltage", "V"))
        return after, signals.replace(polarization=p, phase_fraction=x)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage, linear between samples, with which `step` gives the polarization asked for at the samples.

        The field stays within +-10 MV/m; a target that is no number keeps the voltage where it was.

        Raises:
            BenchError: a time or the polarization is missing, or a time is no finite number.
        """
        time, after = _finite(signals.time, signals.time.size, "time", "s"), state.copy()
        target = np.ascontiguousarray(_one_each(signals.polarization, time.size, "polarization"), dtype=np.float64)
        voltage, x = np.empty(time.size), np.empty(time.size)
        kernel.run_inverse(after, self.material, time, target, voltage, x)
        return after, signals.replace(voltage=voltage, phase_fraction=x)

    def _run(self, state: State, time: Array, voltage: Array) -> tuple[Array, Array]:
        p, x = np.empty(time.size), np.empty(time.size)
        kernel.run(state, self.material, time, voltage, p, x)
        return p, x


def _one_each(values: Array, count: int, name: str) -> Array:
    if values.size != count:
        raise BenchError(
            f"parametrized_single: the block has {count} samples, but {values.size} of {name}; give one for each"
        )
    return values


def _finite(values: Array, count: int, name: str, unit: str) -> Array:
    array = np.ascontiguousarray(_one_each(values, count, name), dtype=np.float64)
    if not math.isfinite(array.sum()):
        first = int(np.argmin(np.isfinite(array)))
        raise BenchError(f"parametrized_single: {name} is {array[first]} {unit} at sample {first}; give finite numbers")
    return array


@functools.lru_cache(maxsize=64)
def _before(link: ParametrizedSingle) -> State:
    """State before the run; read-only, since it is shared."""
    if link.start == "virgin" and link.distribution != "coercive":
        state = branch.fresh_state(link.material, 0.5)
    else:
        state = branch.fresh_state(link.material, 1.0 if link.start == "positive" else 0.0)
    if link.start == "virgin" and link.distribution == "coercive":
        time = np.linspace(0.0, 1.0, _PRERUN_SAMPLES)
        voltage = link.virgin_amplitude * np.sin(20 * np.pi * time) * (1 - time) * link.layer_thickness
        kernel.run(state, link.material, time, voltage, np.empty_like(time), np.empty_like(time))
        state[branch.FIELD] = 0.0  # the drive ends at 0 to rounding
        branch.refresh(state, link.material)
    state.flags.writeable = False
    return state
