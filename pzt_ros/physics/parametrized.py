"""The parametrized ferroelectric: one representative domain whose barrier follows what has switched (thesis 3.3)."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics import parametrized_branch as branch
from pzt_ros.physics import parametrized_inverse as inverse
from pzt_ros.physics import parametrized_kernel as kernel
from pzt_ros.physics.kinetics import thermal_width
from pzt_ros.physics.link import State
from pzt_ros.physics.one_equation import OneEquation, decaying_drive
from pzt_ros.physics.signals import Rest
from pzt_ros.quantities import choice, parameter

_PRERUN_SAMPLES = 10_001  # a thousand a cycle: x+ is within 4e-8 of what ten times as many give
_PRERUN_ACCURACY = 1e-8
_FARTHEST_TAIL = 14.0  # erfc(14) = 5e-87; the integration was tried out to there


@dataclass(frozen=True, kw_only=True)
class Parametrized(OneEquation):
    """Voltage to polarization by one ODE with return-point memory, events located exactly (3.34, 3.35).

    The barrier is exact in both tails and the branches turn and close where the equations say, inside a sample step if
    need be. Memory holds 256 nested loops; a loop nested deeper makes it forget the innermost one.
    """

    kind: ClassVar[str] = "parametrized"
    _kernel: ClassVar[Any] = kernel
    _inverse: ClassVar[Any] = inverse

    shape_ascending: float = parameter(
        None,
        "1",
        "Spread of the barriers over the ascending branch.",
        symbol="s",
        bounds=(0.05, 50.0),
    )
    barrier_ascending: float = parameter(
        None,
        "V/m",
        "Barrier at which most domains switch upwards.",
        symbol="B_e",
        bounds=(1e3, 1e8),
    )
    shape_descending: float = parameter(
        None,
        "1",
        "Spread of the barriers over the descending branch.",
        symbol="s",
        bounds=(0.05, 50.0),
    )
    barrier_descending: float = parameter(
        None,
        "V/m",
        "Barrier at which most domains switch downwards.",
        symbol="B_e",
        bounds=(1e3, 1e8),
    )
    relaxation_time: float = parameter(
        None,
        "s",
        "Time constant of switching at zero barrier.",
        symbol="tau",
        bounds=(1e-9, 1e6),
    )
    domain_polarization: float = parameter(
        None,
        "C/m^2",
        "Polarization of a switched domain at zero field.",
        symbol="P_T",
        bounds=(1e-6, 10.0),
    )
    reciprocal_permittivity: float = parameter(
        None,
        "V*m/C",
        "Field per polarization within a domain.",
        symbol="E_1",
        bounds=(1e4, 1e12),
    )
    saturation_barrier: float = parameter(
        2.0e6,
        "V/m",
        "Outermost barrier, where all domains have switched.",
        symbol="B_sat",
        bounds=(1e4, 1e8),
    )
    start: str = choice(
        "virgin",
        ("virgin", "negative"),
        "State before the run: after the thesis' decaying drive, or negatively saturated.",
    )
    virgin_amplitude: float = parameter(
        1.5e6,
        "V/m",
        "Amplitude A of the pre-run A sin(20 pi t)(1 - t), 0 to 1 s.",
        symbol="A",
        bounds=(0.0, 1e7),
    )

    @functools.cached_property
    def material(self) -> branch.Material:
        """The numbers as the compiled kernel takes them."""
        return branch.Material(
            float(self.barrier_ascending),
            float(self.shape_ascending),
            float(self.barrier_descending),
            float(self.shape_descending),
            float(self.relaxation_time),
            thermal_width(self.reciprocal_permittivity, self.temperature, self.domain_volume),
            float(self.domain_polarization),
            float(self.reciprocal_permittivity),
            float(self.layer_thickness),
            float(self.accuracy),
        )

    def init(self, rest: Rest) -> State:
        """The state after the pre-history and, if the rest voltage is not 0, a ramp to it within 1 s.

        Raises:
            BenchError: saturation lies so many widths of the barrier distribution out that no domain is there.
        """
        self._check_tails()
        state = _after_history(self).copy()
        self._ramp_to(state, rest.voltage)
        state[branch.TIME] = rest.time
        state[[branch.RATE, branch.PAST, branch.REVERSALS, branch.CLOSURES]] = 0.0
        return state

    def _check_tails(self) -> None:
        for name in ("ascending", "descending"):
            shape, barrier = getattr(self, f"shape_{name}"), getattr(self, f"barrier_{name}")
            tail = (self.saturation_barrier / barrier + 1.0) / shape
            if tail > _FARTHEST_TAIL:
                raise BenchError(
                    f"parametrized: saturation_barrier is {tail:.3g} widths out on the {name} branch, the limit is"
                    f" {_FARTHEST_TAIL:.3g}; lower saturation_barrier or raise shape_{name} or barrier_{name}"
                )


@functools.lru_cache(maxsize=64)
def _after_history(link: Parametrized) -> State:
    """State at the end of the pre-history; read-only, since it is shared."""
    material = link.material._replace(accuracy=min(link.accuracy, _PRERUN_ACCURACY))
    state = branch.fresh_state(material, float(link.saturation_barrier))
    if link.start == "virgin":
        time, voltage = decaying_drive(link.virgin_amplitude, link.layer_thickness, _PRERUN_SAMPLES)
        kernel.run(state, tuple(material), time, voltage, np.empty_like(time), np.empty_like(time))
    state.flags.writeable = False
    return state
