"""PI feedback behind a notch filter: what one would take without a model of the hysteresis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.controllers.controller import Feedback
from pzt_ros.controllers.pi import ErrorFeedback, sample_period
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class NotchPI(ErrorFeedback):
    """The honest baseline on a stage with a flexure mode: PI, and a notch that keeps the feedback from exciting it.

    The notch is (s^2 + 2 D d w s + w^2)/(s^2 + 2 D w s + w^2), w the mode, D its width and d what is left in the
    middle, by the bilinear transform with w kept; above the Nyquist frequency there is none.
    """

    kind: ClassVar[str] = "pi_notch"
    takes_over_smoothly: ClassVar[bool] = True

    integral_gain: float = parameter(
        1e9, "V/m/s", "volts per second and metre of error", symbol="Ki", bounds=(0.0, 1e13)
    )
    notch_frequency: float = parameter(1000.0, "Hz", "of the flexure mode", bounds=(0.1, 1e6))
    notch_width: float = parameter(0.5, "1", "damping ratio of the filter's poles", symbol="D", bounds=(0.01, 5.0))
    notch_depth: float = parameter(0.05, "1", "what is left in the middle", symbol="d", bounds=(0.0, 1.0))

    def init(self, model: Chain, feedback: Feedback) -> tuple[float, float, float]:
        """Integral [V] and memory of the notch [V], in balance at the voltage found."""
        found = float(feedback.voltage[-1])
        return found, math.nan, found

    def step(
        self, model: Chain, state: tuple[float, float, float], time: Array, reference: Array, feedback: Feedback
    ) -> tuple[tuple[float, float, float], Array]:
        """Drive voltage [V]."""
        integral, first, second = state
        coefficients = self._coefficients(sample_period(time, feedback.time[-1]))
        if math.isnan(first):
            b0, _, b2, _, a2 = coefficients
            first, second = second * (1.0 - b0), second * (b2 - a2)
        integral, asked = self.asked(integral, time, feedback)
        first, second, out = _filter(asked, first, second, *coefficients)
        return (integral, first, second), out

    def _coefficients(self, period: float) -> tuple[float, float, float, float, float]:
        """b0, b1, b2, a1, a2 of the filter; its gain at rest is 1."""
        angle = 2.0 * math.pi * self.notch_frequency * period
        if angle >= math.pi:
            return 1.0, 0.0, 0.0, 0.0, 0.0
        width = math.sin(angle) * self.notch_width
        whole = 1.0 + width
        middle = -2.0 * math.cos(angle) / whole
        through = width * self.notch_depth
        return (1.0 + through) / whole, middle, (1.0 - through) / whole, middle, (1.0 - width) / whole


@njit(cache=True)
def _filter(
    values: Array, first: float, second: float, b0: float, b1: float, b2: float, a1: float, a2: float
) -> tuple[float, float, Array]:
    """A filter of second order in its transposed direct form 2: memory afterwards, and output."""
    out = np.empty_like(values)
    for k in range(len(values)):
        out[k] = b0 * values[k] + first
        first = b1 * values[k] - a1 * out[k] + second
        second = b2 * values[k] - a2 * out[k]
    return first, second, out
