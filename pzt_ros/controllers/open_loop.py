"""Linear open loop: what one gets from the data sheet's gain alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class OpenLoop(Controller):
    """A straight line from displacement to voltage."""

    kind: ClassVar[str] = "open_loop"
    takes_over_smoothly: ClassVar[bool] = False

    gain: float = parameter(8.0e-8, "m/V", "displacement per volt", bounds=(1e-12, 1e-3))
    voltage_at_zero: float = parameter(0.0, "V", "voltage at zero displacement", bounds=(-1000.0, 1000.0))

    def init(self, model: Chain, feedback: Feedback) -> None:
        """No memory."""

    def step(self, model: Chain, state: None, time: Array, reference: Array, feedback: Feedback) -> tuple[None, Array]:
        """Drive voltage [V]."""
        return None, self.voltage_at_zero + reference / self.gain
