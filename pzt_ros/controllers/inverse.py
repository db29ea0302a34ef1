"""Inverse compensation: the model chain walked backwards (methods.md section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.controllers.controller import NEVER, Controller, Feedback, fade, model_offset
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class Inverse(Controller):
    """The voltage that makes the model follow the reference exactly, from the state the applied voltage has led it to.

    On taking over, model and stage will not agree; the difference is taken into the reference and fades out of it.
    """

    kind: ClassVar[str] = "inverse"
    takes_over_smoothly: ClassVar[bool] = True
    keeps_offset: ClassVar[bool] = True

    handover_time: float = parameter(0.1, "s", "over which the model's offset at take-over fades", bounds=(1e-3, NEVER))

    def init(self, model: Chain, feedback: Feedback) -> tuple[float, float]:
        """The model's offset now [m], and the time of taking over [s]."""
        return model_offset(model, feedback), float(feedback.time[-1])

    def step(
        self, model: Chain, state: tuple[float, float], time: Array, reference: Array, feedback: Feedback
    ) -> tuple[tuple[float, float], Array]:
        """Drive voltage [V]."""
        offset, start = state
        return state, inverse_voltage(model, time, reference + fade(offset, time - start, self.handover_time), feedback)


def inverse_voltage(model: Chain, time: Array, displacement: Array, feedback: Feedback) -> Array:
    """Voltage across the ceramic [V] by which the model reads `displacement` [m] at `time` [s]."""
    _, signals = model.invert(feedback.model, Signals(time, displacement=displacement))
    return signals.voltage
