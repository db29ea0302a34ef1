"""Fatigue: polarization that is lost with the cycles gone through."""

from __future__ import annotations

import math
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

_NEVER = 1e30
"""Cycles to saturation [-]: a power law to the last digit."""

_Law = tuple[float, float, float, float, float, float]
"""What is lost in the end [-], exponent, saturation cycles, way in a cycle [C/m^2], cycles before the first sample,
polarization where P is 0 [C/m^2]."""

_REMANENT = 5
"""Place of the last in a law."""


@dataclass(frozen=True, kw_only=True)
class PolarizationFatigue(Link):
    """P less a part that grows with the cycles N gone through: the way of P so far over four reference polarizations.

    The part is loss * n^exponent * (1 - exp(-(N/n)^exponent)), n the saturation cycles: loss * N^exponent long before
    those, and no more after them. Exponent 1 then loses the same in each cycle. N counts up to the sample before, so
    that the inverse is exact; the difference is loss times the part of a cycle that lies between two samples. It is a
    part of P and of the remanent polarization, for P may count from any state: displacement tells no zero, and an
    identified density has its own.

    Runs follow one another in a stage but not in a chain: the cycles before a run's first sample are a parameter. A
    diagnosis counts them in the order in which it is given the runs, or leaves them at none, as if the stage were poled
    anew for each: whichever fits.
    """

    kind: ClassVar[str] = "polarization_fatigue"
    section: ClassVar[str] = ACTUATOR

    loss: float = parameter(0.0, "1", "part of the polarization lost in the first cycle", bounds=(0.0, 1.0))
    exponent: float = parameter(1.0, "1", "power of the number of cycles", bounds=(0.1, 3.0))
    saturation_cycles: float = parameter(_NEVER, "1", "cycles after which no more is lost", bounds=(1e-3, _NEVER))
    reference_polarization: float = parameter(
        0.25, "C/m^2", "a quarter of the way of P in a cycle", bounds=(1e-6, 10.0)
    )
    cycles_before: float = parameter(0.0, "1", "cycles before the first sample", bounds=(0.0, 1e12))
    remanent_polarization: float = parameter(
        0.0, "C/m^2", "polarization where P is counted from, which is lost as well", bounds=(-1.0, 1.0)
    )

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, the last P without fatigue, and its way so far [both C/m^2]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization of the fresh ceramic to polarization."""
        after, out = state.copy(), np.empty_like(signals.polarization)
        _tire(after, signals.polarization, out, self._law)
        return after, signals.replace(polarization=out)

    def carry(self, signals: Signals, change: Change) -> Change:
        """What is left of the change, less what its way costs."""
        out = np.empty_like(change.polarization, order="C")
        _tire_columns(self.init(Rest()), signals.polarization, change.polarization, out, self._law)
        return replace(change, polarization=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization wanted to that of the fresh ceramic; exact."""
        after, fresh = state.copy(), np.empty_like(signals.polarization)
        _untire(after, signals.polarization, fresh, self._law)
        return after, signals.replace(polarization=fresh)

    def gone_through(self, polarization: Array) -> float:
        """Cycles in a run, by the polarization of the fresh ceramic [C/m^2]."""
        return float(np.sum(np.abs(np.diff(polarization)))) / (4.0 * self.reference_polarization)

    @property
    def _law(self) -> _Law:
        lost = self.loss * self.saturation_cycles**self.exponent
        way = 4.0 * self.reference_polarization
        return lost, self.exponent, self.saturation_cycles, way, self.cycles_before, self.remanent_polarization


@njit(cache=True)
def _left(state: Array, law: _Law) -> float:
    """Part of the polarization that is left [-]."""
    lost, exponent, saturation, way, before, _ = law
    cycles = before + state[_TRAVEL] / way
    return max(1.0 + lost * math.expm1(-((cycles / saturation) ** exponent)), _LEAST)


@njit(cache=True)
def _worn(state: Array, left: float, law: _Law) -> float:
    """What is lost with a way of 1 C/m^2 more [m^2/C], where so much is left."""
    lost, exponent, saturation, way, before, _ = law
    cycles = before + state[_TRAVEL] / way
    if cycles == 0.0 or left == _LEAST:
        return 0.0
    share = (cycles / saturation) ** exponent
    return lost * exponent * share / cycles * math.exp(-share) / way


@njit(cache=True)
def _count(state: Array, fresh: float) -> None:
    if state[_SEEN] != 0.0:
        state[_TRAVEL] += abs(fresh - state[_POLARIZATION])
    state[_SEEN], state[_POLARIZATION] = 1.0, fresh


@njit(cache=True)
def _tire(state: Array, fresh: Array, out: Array, law: _Law) -> None:
    for k in range(fresh.size):
        left = _left(state, law)
        out[k] = fresh[k] * left + law[_REMANENT] * (left - 1.0)
        _count(state, fresh[k])


@njit(cache=True)
def _tire_columns(state: Array, fresh: Array, change: Columns, out: Columns, law: _Law) -> None:
    """The tangent of `_tire`."""
    travel = np.zeros(change.shape[1])  # change of the way so far
    for k in range(fresh.size):
        left = _left(state, law)
        worn = _worn(state, left, law)
        step = fresh[k] - state[_POLARIZATION] if k > 0 else 0.0
        sign = np.sign(step)
        for i in range(change.shape[1]):
            out[k, i] = left * change[k, i] - (fresh[k] + law[_REMANENT]) * worn * travel[i]
            if k > 0:
                travel[i] += sign * (change[k, i] - change[k - 1, i])
        _count(state, fresh[k])


@njit(cache=True)
def _untire(state: Array, wanted: Array, fresh: Array, law: _Law) -> None:
    for k in range(wanted.size):
        left = _left(state, law)
        fresh[k] = (wanted[k] - law[_REMANENT] * (left - 1.0)) / left
        _count(state, fresh[k])
