"""A sensor whose curve is not quite a straight line."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.change import Change, scaled
from pzt_ros.physics.link import SENSOR, Link, State, no_state
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True, kw_only=True)
class SensorNonlinearity(Link):
    """y + amplitude * (cos(mix) * u^2/R + sin(mix) * u^3/R^2) + quartic * u^4/R^3 + ... + septic * u^7/R^6, u = y - c.

    The size and which of the two lower powers it is; the four higher ones for a curve that waves, which they follow to
    a thousandth over one wave. R and c are given, not found: range and zero of the sensor, or half the width and the
    middle of what it reads, where the powers are least alike.
    """

    kind: ClassVar[str] = "sensor_nonlinearity"
    section: ClassVar[str] = SENSOR

    amplitude: float = parameter(0.0, "1", "error at the end of the range over the range", bounds=(-0.5, 0.5))
    mix: float = parameter(0.0, "rad", "0 for quadratic, pi/2 for cubic", bounds=(-math.pi, math.pi))
    quartic: float = parameter(0.0, "1", "of y^4, error at the end of the range over the range", bounds=(-5.0, 5.0))
    quintic: float = parameter(0.0, "1", "of y^5, error at the end of the range over the range", bounds=(-5.0, 5.0))
    sextic: float = parameter(0.0, "1", "of y^6, error at the end of the range over the range", bounds=(-5.0, 5.0))
    septic: float = parameter(0.0, "1", "of y^7, error at the end of the range over the range", bounds=(-5.0, 5.0))
    range: float = parameter(1e-5, "m", "of the sensor", symbol="R", bounds=(1e-9, 1.0))
    centre: float = parameter(0.0, "m", "reading without error about which it bends", symbol="c", bounds=(-1.0, 1.0))

    def init(self, rest: Rest) -> State:
        """No memory."""
        return no_state()

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement to reading."""
        u = signals.displacement - self.centre
        bend = np.zeros_like(u)
        for power in reversed(self._powers):
            bend = u * (power + bend)
        return state, signals.replace(displacement=signals.displacement + u * bend)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The slope of the curve times the change."""
        u = signals.displacement - self.centre
        bend = np.zeros_like(u)
        for order, power in reversed(list(enumerate(self._powers, start=2))):
            bend = u * (order * power + bend)
        return replace(change, displacement=scaled(1.0 + bend, change.displacement))

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Reading wanted to displacement; exact on the rising part of the curve about its centre, its end beyond."""
        out = np.empty_like(signals.displacement)
        _unbend(signals.displacement - self.centre, out, np.array([1.0, *self._powers]), *self._rising_part)
        return state, signals.replace(displacement=self.centre + out)

    @property
    def _powers(self) -> tuple[float, ...]:
        """Coefficients of u^2 [1/m] to u^7 [1/m^6]."""
        return (
            self.amplitude * math.cos(self.mix) / self.range,
            self.amplitude * math.sin(self.mix) / self.range**2,
            self.quartic / self.range**3,
            self.quintic / self.range**4,
            self.sextic / self.range**5,
            self.septic / self.range**6,
        )

    @property
    def _rising_part(self) -> tuple[float, float]:
        """Where the curve rises about its centre [m from there]: between the turns next to it."""
        slope = [1.0, *(n * power * self.range ** (n - 1) for n, power in enumerate(self._powers, start=2))]
        roots = np.polynomial.polynomial.polyroots(slope)
        turns = np.real(roots[np.abs(np.imag(roots)) < 1e-12]) * self.range
        below, above = turns[turns < 0.0], turns[turns > 0.0]
        return float(np.max(below, initial=-math.inf)), float(np.min(above, initial=math.inf))


@njit(cache=True)
def _unbend(reading: Array, out: Array, powers: Array, low: float, high: float) -> None:
    """Newton's method from the straight line, kept within the rising part by halving."""
    for k in range(reading.size):
        below, above = low, high
        y = min(max(reading[k], low), high)
        for _ in range(60):
            miss, slope = 0.0, 0.0
            for n in range(powers.size - 1, -1, -1):
                miss = y * (powers[n] + miss)
                slope = (n + 1) * powers[n] + y * slope
            miss -= reading[k]
            if miss > 0.0:
                above = y
            else:
                below = y
            ahead = y - miss / slope if slope > 0.0 else math.inf
            if not below <= ahead <= above:
                ahead = 0.5 * (below + above) if math.isfinite(below) and math.isfinite(above) else 2.0 * y
            if abs(ahead - y) <= 1e-16 * abs(reading[k]):
                y = ahead
                break
            y = ahead
        out[k] = y
