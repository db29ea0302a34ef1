"""Fatigue: polarization that is lost with the cycles gone through."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.change import Change, Columns
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _POLARIZATION, _TRAVEL, _SIZE = 0, 1, 2, 3

_LEAST = 0.01
"""What is left at the end; the law is one for small losses."""


@dataclass(frozen=True, kw_only=True)
class PolarizationFatigue(Link):
    """P times 1 - loss * N^exponent, N the cycles gone through: the way of P so far over four reference polarizations.

    Exponent 1 loses the same in each cycle. N counts up to the sample before, so that the inverse is exact; the
    difference is loss times the part of a cycle that lies between two samples. Runs follow one another in a stage but
    not in a chain: the cycles before a run's first sample are a parameter.
    """

    kind: ClassVar[str] = "polarization_fatigue"
    section: ClassVar[str] = ACTUATOR

    loss: float = parameter(0.0, "1", "part of the polarization lost in the first cycle", bounds=(0.0, 1.0))
    exponent: float = parameter(1.0, "1", "power of the number of cycles", bounds=(0.1, 3.0))
    reference_polarization: float = parameter(
        0.25, "C/m^2", "a quarter of the way of P in a cycle", bounds=(1e-6, 10.0)
    )
    cycles_before: float = parameter(0.0, "1", "cycles before the first sample", bounds=(0.0, 1e12))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, the last P without fatigue, and its way so far [both C/m^2]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization of the fresh ceramic to polarization."""
        after, out = state.copy(), np.empty_like(signals.polarization)
        _tire(after, signals.polarization, out, *self._law)
        return after, signals.replace(polarization=out)

    def carry(self, signals: Signals, change: Change) -> Change:
        """What is left of the change, less what its way costs."""
        out = np.empty_like(change.polarization, order="C")
        _tire_columns(self.init(Rest()), signals.polarization, change.polarization, out, *self._law)
        return replace(change, polarization=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization wanted to that of the fresh ceramic; exact."""
        after, fresh = state.copy(), np.empty_like(signals.polarization)
        _untire(after, signals.polarization, fresh, *self._law)
        return after, signals.replace(polarization=fresh)

    @property
    def _law(self) -> tuple[float, float, float, float]:
        return self.loss, self.exponent, 4.0 * self.reference_polarization, self.cycles_before


@njit(cache=True)
def _left(state: Array, loss: float, exponent: float, way: float, before: float) -> float:
    """Part of the polarization that is left [-]."""
    cycles = before + state[_TRAVEL] / way
    if exponent != 1.0:
        cycles = cycles**exponent
    return max(1.0 - loss * cycles, _LEAST)


@njit(cache=True)
def _count(state: Array, fresh: float) -> None:
    if state[_SEEN] != 0.0:
        state[_TRAVEL] += abs(fresh - state[_POLARIZATION])
    state[_SEEN], state[_POLARIZATION] = 1.0, fresh


@njit(cache=True)
def _tire(state: Array, fresh: Array, out: Array, loss: float, exponent: float, way: float, before: float) -> None:
    for k in range(fresh.size):
        out[k] = fresh[k] * _left(state, loss, exponent, way, before)
        _count(state, fresh[k])


@njit(cache=True)
def _tire_columns(
    state: Array, fresh: Array, change: Columns, out: Columns,
    loss: float, exponent: float, way: float, before: float,
) -> None:  # fmt: skip
    """The tangent of `_tire`."""
    travel = np.zeros(change.shape[1])  # change of the way so far
    for k in range(fresh.size):
        left, cycles = _left(state, loss, exponent, way, before), before + state[_TRAVEL] / way
        worn = loss * exponent * cycles ** (exponent - 1.0) / way if cycles > 0.0 and left > _LEAST else 0.0
        step = fresh[k] - state[_POLARIZATION] if k > 0 else 0.0
        sign = np.sign(step)
        for i in range(change.shape[1]):
            out[k, i] = left * change[k, i] - fresh[k] * worn * travel[i]
            if k > 0:
                travel[i] += sign * (change[k, i] - change[k - 1, i])
        _count(state, fresh[k])


@njit(cache=True)
def _untire(state: Array, wanted: Array, fresh: Array, loss: float, exponent: float, way: float, before: float) -> None:
    for k in range(wanted.size):
        fresh[k] = wanted[k] / _left(state, loss, exponent, way, before)
        _count(state, fresh[k])
