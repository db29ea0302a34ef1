"""An internal bias field that goes on from run to run: each finds it as the time before has left it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.effects.bias_field import InternalBias
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class Imprint(InternalBias):
    """The ceramic sees the voltage less settled_voltage - missing_voltage exp(-t/time_constant), t since the run began.

    As `bias_field`, but what builds up over a session is further on in each run, by as long as nobody recorded.
    """

    kind: ClassVar[str] = "imprint"

    missing_voltage: float = parameter(0.0, "V", "that is to build up yet as a run begins", bounds=(-1e4, 1e4))
    settled_voltage: float = parameter(0.0, "V", "internal field times layer thickness, at the end", bounds=(-1e4, 1e4))
    time_constant: float = parameter(100.0, "s", "over which it builds up", bounds=(1e-3, 1e6))

    def _course(self, time: Array, begin: float) -> Array:
        course: Array = self.settled_voltage - self.missing_voltage * np.exp(-(time - begin) / self.time_constant)
        return course
