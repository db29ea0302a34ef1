"""Observer-based inverse: the model walked backwards from where the observer sees the stage (methods.md section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.controllers.controller import Controller, Feedback, fade, model_offset
from pzt_ros.controllers.inverse import inverse_voltage
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class ObserverInverse(Controller):
    """The inverse of model plus disturbance: what the observer sees beyond the model is taken off the reference.

    Its gain is the observer's: the disturbance is as quick and as quiet as the observer makes it. On taking over, what
    the disturbance would change at once fades in.
    """

    kind: ClassVar[str] = "observer_inverse"
    takes_over_smoothly: ClassVar[bool] = True

    handover_time: float = parameter(0.1, "s", "over which the jump at take-over fades", bounds=(1e-3, 10.0))
    disturbance_limit: float = parameter(
        1e-5, "m", "the disturbance counts up to plus and minus this", bounds=(0.0, 1e-3)
    )

    def init(self, model: Chain, feedback: Feedback) -> tuple[float, float]:
        """What to add to the target to begin at the voltage found [m], and the time of taking over [s]."""
        return model_offset(model, feedback) + self._disturbance(feedback), float(feedback.time[-1])

    def step(
        self, model: Chain, state: tuple[float, float], time: Array, reference: Array, feedback: Feedback
    ) -> tuple[tuple[float, float], Array]:
        """Drive voltage [V]."""
        jump, start = state
        target = reference - self._disturbance(feedback) + fade(jump, time - start, self.handover_time)
        return state, inverse_voltage(model, time, target, feedback)

    def _disturbance(self, feedback: Feedback) -> float:
        """What the observer sees beyond the model now, both as the sensor reads it [m]."""
        if feedback.predicted.size == 0:
            return 0.0
        beyond = float(feedback.estimate[-1] - feedback.predicted[-1])
        return min(max(beyond, -self.disturbance_limit), self.disturbance_limit)
