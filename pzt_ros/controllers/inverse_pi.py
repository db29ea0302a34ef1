"""Inverse compensation with feedback on what it leaves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from pzt_ros.controllers.controller import Controller, Feedback, model_offset, tracking_error
from pzt_ros.controllers.inverse import inverse_voltage
from pzt_ros.controllers.pi import proportional_integral, sample_period
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class InversePI(Controller):
    """A PI controller moves the reference of the inverse: no volts in its gains, and the loop gain is even."""

    kind: ClassVar[str] = "inverse_pi"
    takes_over_smoothly: ClassVar[bool] = True

    proportional_gain: float = parameter(0.0, "1", "share of the error", symbol="Kp", bounds=(0.0, 10.0))
    integral_gain: float = parameter(30.0, "1/s", "share of the error per second", symbol="Ki", bounds=(0.0, 1e5))
    integral_limit: float = parameter(5e-6, "m", "the correction stays within plus and minus this", bounds=(0.0, 1e-3))

    def init(self, model: Chain, feedback: Feedback) -> float:
        """The correction [m] with which the inverse begins at the voltage found."""
        return model_offset(model, feedback)

    def step(
        self, model: Chain, state: float, time: Array, reference: Array, feedback: Feedback
    ) -> tuple[float, Array]:
        """Drive voltage [V]."""
        error = tracking_error(feedback)
        step = self.integral_gain * sample_period(time, feedback.time[-1])
        integral, correction = proportional_integral(
            error, state, self.proportional_gain, step, self.integral_limit, feedback.cut
        )
        return integral, inverse_voltage(model, time, reference + correction, feedback)
