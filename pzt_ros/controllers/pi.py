"""Proportional-integral feedback, as a part that others use, and as a controller of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.controllers.controller import Controller, Feedback, tracking_error
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class ErrorFeedback(Controller):
    """Gains of proportional-integral feedback in volts, for every controller that has it."""

    proportional_gain: float = parameter(0.0, "V/m", "volts per metre of error", symbol="Kp", bounds=(0.0, 1e9))
    integral_gain: float = parameter(
        5e8, "V/m/s", "volts per second and metre of error", symbol="Ki", bounds=(0.0, 1e13)
    )
    integral_limit: float = parameter(200.0, "V", "the integral stays within plus and minus this", bounds=(0.0, 1e4))

    def asked(self, integral: float, time: Array, feedback: Feedback) -> tuple[float, Array]:
        """The integral after a block [V], and the voltage asked for over it [V, shape (n,)]."""
        step = self.integral_gain * sample_period(time, feedback.time[-1])
        error = tracking_error(feedback)
        return proportional_integral(error, integral, self.proportional_gain, step, self.integral_limit, feedback.cut)


@dataclass(frozen=True, kw_only=True)
class PI(ErrorFeedback):
    """The honest baseline: proportional-integral feedback of the tracking error, nothing else.

    Feedback is one block late, because a block is measured before the next is computed.
    """

    kind: ClassVar[str] = "pi"
    takes_over_smoothly: ClassVar[bool] = True

    def init(self, model: Chain, feedback: Feedback) -> float:
        """The integral [V] that continues the voltage found."""
        return float(feedback.voltage[-1])

    def step(
        self, model: Chain, state: float, time: Array, reference: Array, feedback: Feedback
    ) -> tuple[float, Array]:
        """Drive voltage [V]."""
        return self.asked(state, time, feedback)


def sample_period(time: Array, before: float = 0.0) -> float:
    """The mean time between samples of a block [s]; a block of one sample follows the one at `before` [s]."""
    return float(time[-1] - time[0]) / (len(time) - 1) if len(time) > 1 else float(time[0] - before)


@njit(cache=True)
def proportional_integral(
    error: Array, integral: float, proportional: float, integral_step: float, limit: float, cut: float = 0.0
) -> tuple[float, Array]:
    """The integral after a block of error, held at its limit, and the output over the block [shape of `error`].

    Where the bounds took something from the last output (`cut`), errors that ask for more of it do not count.
    """
    out = np.empty_like(error)
    for i in range(len(error)):
        if error[i] * cut <= 0.0:
            integral = min(max(integral + integral_step * error[i], -limit), limit)
        out[i] = proportional * error[i] + integral
    return integral, out
