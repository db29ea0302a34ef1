"""Profile-likelihood intervals: how far a coordinate may go, all others refitted, until the misfit has risen too much.

A standard error takes the misfit for a parabola; where the model bends, or another parameter is stopped by its bound,
the interval is longer on one side than on the other (Venzon and Moolgavkar 1988). Residuals that remember themselves
say less than as many independent ones, so the rise of the sum of squares is measured in units of the noise power that
the coordinate feels, s^2 / v: variance of its estimate with the residual's autocovariance (`covariance`) over the
inverse curvature of the sum of squares (Chandler and Bate 2007). For a linear model the interval is +-1.96 s.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.sysid.covariance import INDISTINCT, remembered
from pzt_ros.sysid.gauss_newton import Problem, solve

QUANTILE = 1.959964
"""Of the normal distribution, for 95 %; its square is that of chi^2 with one degree of freedom."""

_STEPS = 20  # of a refit
_POLISH = 1e-9  # share of the cost to which the optimum is found before anything is compared with it
_EXACT = 0.01  # of the quantile, to which the end of an interval is found
_TRIES = 15  # refits on one side
_LARGEST_STRIDE = 4.0
_BETTER = 0.1  # fall of the misfit below the optimum, in units of the noise power, that is no rounding


class BetterFitError(Exception):
    """A refit came below what was given as the optimum; `args[0]` is its vector."""


@dataclass(frozen=True)
class Interval:
    """95 % interval of a coordinate; None on a side where its bound is reached and the misfit has not risen enough."""

    lower: float | None
    upper: float | None

    def through(self, rising: Callable[[float], float]) -> Interval:
        """The interval of a rising function of the coordinate."""
        lower, upper = self.lower, self.upper
        return Interval(None if lower is None else rising(lower), None if upper is None else rising(upper))


class Profile:
    """The misfit along single coordinates of a fitted problem.

    Args:
        problem: as `gauss_newton.solve` takes it.
        vector: where its fit ended [shape (p,)].
        bounds: lowest and highest vector [each shape (p,)].
        prior: rows and targets of the fit, as `solve` takes them.
        widened: factor on standard errors and intervals, for what the model itself is off by.

    Attributes:
        best: the optimum, found anew to more digits.

    Raises:
        BenchError: the problem is not defined at the vector.
    """

    def __init__(
        self,
        problem: Problem,
        vector: Array,
        bounds: tuple[Array, Array],
        prior: tuple[Array, Array] | None = None,
        widened: float = 1.0,
    ) -> None:
        self.problem, self.bounds, self.prior, self._widened = problem, bounds, prior, widened
        self.best = solve(problem, vector, *bounds, most_steps=_STEPS, tolerance=_POLISH, prior=prior)
        _, self._jacobians = problem.linearise(self.best.vector)
        jacobian = np.vstack(self._jacobians).astype(float)
        rows = np.zeros((0, vector.size)) if prior is None else prior[0]
        size = np.linalg.norm(jacobian, axis=0)
        size[size == 0.0] = 1.0
        _, s, vt = np.linalg.svd(np.vstack((jacobian, rows)) / size, full_matrices=False)
        sound = s > INDISTINCT * s[0]
        root = vt[sound].T / s[sound] / size[:, None]
        self._inverse = root @ root.T

    def interval(self, place: int) -> Interval:
        """The interval of coordinate `place`.

        Raises:
            BetterFitError: the optimum is none; fit again from the error's vector.
        """
        power, value = self._noise_power(place), float(self.best.vector[place])
        if math.isinf(power):  # it changes nothing
            return Interval(None, None)
        if power == 0.0:
            return Interval(value, value)
        return Interval(self._end(place, power, -1.0), self._end(place, power, 1.0))

    def std(self, place: int) -> float:
        """Standard error of coordinate `place`, that of `parameter_covariance`."""
        return math.sqrt(self._noise_power(place) * self._inverse[place, place])

    def _noise_power(self, place: int) -> float:
        """What an independent sample's variance would have to be for an estimate as uncertain as it is."""
        variance = weight = 0.0
        for residual, jacobian in zip(self.best.residuals, self._jacobians, strict=True):
            gain = jacobian @ self._inverse[place]
            variance += float(gain @ remembered(residual, gain))
            weight += float(gain @ gain)
        n, spent = sum(r.size for r in self.best.residuals), len(self._inverse) + len(self.best.residuals)
        return self._widened**2 * variance / weight * n / max(1, n - spent) if weight > 0.0 else math.inf

    def _end(self, place: int, power: float, side: float) -> float | None:
        """Where the misfit has risen by the quantile on one side; None where the bound comes first."""
        origin = float(self.best.vector[place])
        room = (self.bounds[1][place] - origin) if side > 0.0 else (origin - self.bounds[0][place])
        inner, outer = (0.0, 0.0), (math.inf, math.inf)  # distances, and the root of the rise there
        known = self.best.vector
        distance = QUANTILE * math.sqrt(power * self._inverse[place, place])
        for _ in range(_TRIES):
            distance = min(distance, room)
            rise, vector = self._rise(place, origin + side * distance, known, power)
            if abs(rise - QUANTILE) <= _EXACT * QUANTILE:
                break
            if rise < QUANTILE:
                if distance >= room:
                    return None
                inner, known = (distance, rise), vector
            else:
                outer = (distance, rise)
            distance = _next(inner, outer)
        return origin + side * distance

    def _rise(self, place: int, value: float, known: Array, power: float) -> tuple[float, Array]:
        """Root of the rise of the misfit over the noise power, and the vector, with one coordinate held at a value."""
        along = self._inverse[place] / self._inverse[place, place]
        rise, vector = self._held(place, value, known + (value - known[place]) * along, power)
        if rise > QUANTILE**2:  # what hardly counts may have been led into another valley
            other, there = self._held(place, value, known, power)
            rise, vector = (other, there) if other < rise else (rise, vector)
        if rise < -_BETTER:
            raise BetterFitError(vector)
        return math.sqrt(max(rise, 0.0)), vector if math.isfinite(rise) else known

    def _held(self, place: int, value: float, start: Array, power: float) -> tuple[float, Array]:
        """Rise of the misfit over the noise power refitted from a start with one coordinate held, and the vector."""
        low, high = (bound.copy() for bound in self.bounds)
        low[place] = high[place] = value
        tolerance = 2.0 * _EXACT * power / max(self.best.cost, power)
        try:
            found = solve(self.problem, start, low, high, most_steps=_STEPS, tolerance=tolerance, prior=self.prior)
        except BenchError:  # a link refuses the value: no further
            return math.inf, start
        return (found.cost - self.best.cost) / power, found.vector


def _next(inner: tuple[float, float], outer: tuple[float, float]) -> float:
    """Where the root of the rise, nearly proportional to the distance, would reach the quantile."""
    if math.isinf(outer[0]):
        return inner[0] * min(_LARGEST_STRIDE, 1.05 * QUANTILE / max(inner[1], 1e-9))
    share = (QUANTILE - inner[1]) / (outer[1] - inner[1]) if math.isfinite(outer[1]) else 0.5
    return inner[0] + min(max(share, 0.05), 0.95) * (outer[0] - inner[0])
