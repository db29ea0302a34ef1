"""A sensor whose curve is not quite a straight line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.link import SENSOR, Link, State, no_state
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class SensorNonlinearity(Link):
    """y + amplitude * (cos(mix) * y^2/R + sin(mix) * y^3/R^2): one size, and which of the two powers it is.

    R is given, not found: the range of the sensor, or the span of the record.
    """

    kind: ClassVar[str] = "sensor_nonlinearity"
    section: ClassVar[str] = SENSOR

    amplitude: float = parameter(0.0, "1", "error at the end of the range over the range", bounds=(-0.5, 0.5))
    mix: float = parameter(0.0, "rad", "0 for quadratic, pi/2 for cubic", bounds=(-math.pi, math.pi))
    range: float = parameter(1e-5, "m", "of the sensor", symbol="R", bounds=(1e-9, 1.0))

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement to reading."""
        y = signals.displacement
        quadratic, cubic = self._powers
        return state, signals.replace(displacement=y * (1.0 + y * (quadratic + y * cubic)))

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Reading wanted to displacement; exact on the rising part of the curve about zero, its end beyond."""
        out = np.empty_like(signals.displacement)
        quadratic, cubic = self._powers
        _unbend(signals.displacement, out, quadratic, cubic, *_rising_part(quadratic, cubic))
        return state, signals.replace(displacement=out)

    @property
    def _powers(self) -> tuple[float, float]:
        """Coefficients of y^2 [1/m] and of y^3 [1/m^2]."""
        return (
            self.amplitude * math.cos(self.mix) / self.range,
            self.amplitude * math.sin(self.mix) / self.range**2,
        )


def _rising_part(quadratic: float, cubic: float) -> tuple[float, float]:
    """Where the curve rises about zero [m]: between the roots of 1 + 2 q y + 3 c y^2 next to it."""
    root = quadratic * quadratic - 3.0 * cubic
    turns = (
        [-1.0 / (quadratic + s * math.sqrt(root)) for s in (1, -1) if quadratic + s * math.sqrt(root)]
        if root > 0
        else []
    )
    below, above = [y for y in turns if y < 0.0], [y for y in turns if y > 0.0]
    return max(below, default=-math.inf), min(above, default=math.inf)


@njit(cache=True)
def _unbend(reading: Array, out: Array, quadratic: float, cubic: float, low: float, high: float) -> None:
    """Newton's method from the straight line, kept within the rising part by halving."""
    for k in range(reading.size):
        below, above = low, high
        y = min(max(reading[k], low), high)
        for _ in range(60):
            miss = y * (1.0 + y * (quadratic + y * cubic)) - reading[k]
            if miss > 0.0:
                above = y
            else:
                below = y
            slope = 1.0 + y * (2.0 * quadratic + 3.0 * y * cubic)
            ahead = y - miss / slope if slope > 0.0 else math.inf
            if not below <= ahead <= above:
                ahead = 0.5 * (below + above) if math.isfinite(below) and math.isfinite(above) else 2.0 * y
            if abs(ahead - y) <= 1e-16 * abs(reading[k]):
                y = ahead
                break
            y = ahead
        out[k] = y
