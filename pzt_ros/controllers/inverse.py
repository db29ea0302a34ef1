"""Inverse compensation: the model chain walked backwards (methods.md section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.controllers.controller import Controller, Feedback
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array, Signals


@dataclass(frozen=True, kw_only=True)
class Inverse(Controller):
    """The voltage that makes the model follow the reference exactly, from the state the applied voltage has brought it to."""

    kind: ClassVar[str] = "inverse"

    def init(self, model: Chain, feedback: Feedback) -> None:
        """No memory beyond the model's."""

    def step(self, model: Chain, state: None, time: Array, reference: Array, feedback: Feedback) -> tuple[None, Array]:
        """Drive voltage [V]."""
        return None, inverse_voltage(model, time, reference, feedback)


def inverse_voltage(model: Chain, time: Array, displacement: Array, feedback: Feedback) -> Array:
    """Voltage across the ceramic [V] by which the model reads `displacement` [m] at `time` [s]."""
    _, signals = model.invert(feedback.model, Signals(time, displacement=displacement))
    return signals.voltage
