"""The Bouc-Wen model with two elements, as a link of the chain: hysteresis that remembers no reversals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pzt_ros.physics import bouc_wen_kernel as kernel
from pzt_ros.physics.bouc_wen_kernel import Elements
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Rest
from pzt_ros.physics.switching import Switching
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class BoucWen(Switching):
    """Voltage to polarization by a straight line and two elements that hold back until they slip, at any rate alike.

    Each element z runs towards 1 upwards and -1 downwards, dz = (dE - b |dE| z - (1 - b) dE |z|) / field (Wen, J. Eng.
    Mech. Div. ASCE 102, 1976, exponent 1, b = beta / (beta + gamma)); b = 1 is Dahl's friction. P is the straight line
    less height times z (as displacement is in Low and Guo, IEEE Trans. Rehab. Eng. 3, 1995); the height may grow with
    the field. An element of negative height leads the field, which no ceramic does, but friction against a stage may.
    An element knows nothing but where it is: minor loops neither close nor are wiped out, as in a Preisach model.

    P rises with the field wherever the susceptibility is above the sum of 2 b height / field.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], both z [-].
    """

    kind: ClassVar[str] = "bouc_wen"
    knows_no_rate: ClassVar[bool] = True
    _kernel: ClassVar[Any] = kernel

    susceptibility: float = parameter(
        1.5e-7, "C/(V*m)", "with both elements slipping", symbol="1/E_1", bounds=(1e-12, 1e-4)
    )
    height_soft: float = parameter(0.005, "C/m^2", "what the element holds back that slips first", bounds=(-1e2, 1e2))
    field_soft: float = parameter(1.5e5, "V/m", "over which that element begins to slip", bounds=(1.0, 1e9))
    shape_soft: float = parameter(1.0, "1", "b of that element", symbol="b", bounds=(0.5, 50.0))
    height_hard: float = parameter(0.02, "C/m^2", "what the element holds back that slips later", bounds=(-1e2, 1e2))
    field_hard: float = parameter(6e5, "V/m", "over which that element begins to slip", bounds=(1.0, 1e9))
    shape_hard: float = parameter(1.0, "1", "b of that element", symbol="b", bounds=(0.5, 50.0))
    growth: float = parameter(0.0, "m/V", "of both heights with the field, in parts of them", bounds=(-1e-2, 1e-2))
    polarization_offset: float = parameter(0.0, "C/m^2", "of domains that never switch", bounds=(-10.0, 10.0))

    @cached_property
    def _numbers(self) -> Elements:
        return Elements(
            heights=np.array([self.height_soft, self.height_hard]),
            fields=np.array([self.field_soft, self.field_hard]),
            shapes=np.array([self.shape_soft, self.shape_hard]),
            growth=self.growth,
            susceptibility=self.susceptibility,
            offset=self.polarization_offset,
            layer_thickness=self.layer_thickness,
        )

    def init(self, rest: Rest) -> State:
        """Neither element displaced at 0 V, then straight to the rest."""
        numbers = self._numbers
        slope = (numbers.susceptibility - float(np.sum(numbers.heights / numbers.fields))) / self.layer_thickness
        state = np.array([rest.time, 0.0, slope, 0.0, 0.0])
        self._run(state, np.array([rest.time]), np.array([rest.voltage]))
        return state

    @property
    def _state_size(self) -> int:
        return kernel.HEAD + len(self._numbers.heights)
