"""From polarization to displacement by a polynomial, with the piezoelectric cross term."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.change import Change, scaled
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _POLARIZATION, _VOLTAGE, _SIZE = 0, 1, 2, 3

_POLED = 0.2
"""P [C/m^2] on whose side of the turning point an inverse works before the link has seen any."""

_FARTHEST = 10.0
"""No polarization is further from the last one [C/m^2]."""

_NEXT_TO = 1e-9
"""From the end of a branch [C/m^2]."""

_NEWTON_STEPS = 80


@dataclass(frozen=True, kw_only=True)
class StrainLaw(Link):
    """Displacement = linear P + quadratic P^2 + cubic P^3 + field P U: what an identified stage may need.

    Electrostriction is the quadratic term (active length times zeta), with a bias polarization also the linear one;
    the cross term is the field's share, 2 Q P eps E in Devonshire's free energy when P there stands for the domains'
    part. Coefficients are those of the displacement, as lengths and thicknesses cannot be told from them.
    """

    kind: ClassVar[str] = "strain_law"
    section: ClassVar[str] = ACTUATOR

    linear: float = parameter(0.0, "m^3/C", "displacement over P", bounds=(-1.0, 1.0))
    quadratic: float = parameter(1.8344e-4, "m^5/C^2", "displacement over P^2", bounds=(-1.0, 1.0))
    cubic: float = parameter(0.0, "m^7/C^3", "displacement over P^3", bounds=(-10.0, 10.0))
    field: float = parameter(0.0, "m^3/(C*V)", "displacement over P times voltage", bounds=(-1e-2, 1e-2))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, the last polarization that strained [C/m^2], the last voltage [V]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization and voltage to displacement."""
        after, p = state.copy(), signals.straining
        slope = self.linear + p * (self.quadratic + p * self.cubic)
        if self.field != 0.0:
            slope = slope + self.field * signals.voltage
        if p.size:
            after[_SEEN], after[_POLARIZATION] = 1.0, p[-1]
            after[_VOLTAGE] = signals.voltage[-1] if signals.voltage.size else 0.0
        return after, signals.replace(displacement=p * slope)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The slope of the law over P times the change."""
        p = signals.straining
        slope = self.linear + p * (2.0 * self.quadratic + p * 3.0 * self.cubic)
        if self.field != 0.0:
            slope = slope + self.field * signals.voltage
        return replace(change, displacement=scaled(slope, change.straining))

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement to polarization, on the monotone branch that the last polarization is on, its end beyond.

        The cross term needs the voltage, which the way back does not know yet: where the signals have none, the last
        one counts. Its error is field * P * (change of the voltage since).
        """
        after, found = state.copy(), np.empty_like(signals.displacement)
        known = signals.voltage.size > 0
        voltage = signals.voltage if known else np.full_like(found, after[_VOLTAGE])
        _invert(after, signals.displacement, voltage, found, self.linear, self.quadratic, self.cubic, self.field)
        return after, signals.replace(polarization=found, strain_polarization=found)


@njit(cache=True)
def _branch(near: float, linear: float, quadratic: float, cubic: float) -> tuple[float, float]:
    """The stretch about `near` without a turn of linear P + quadratic P^2 + cubic P^3."""
    low, high = -math.inf, math.inf
    first, second = math.inf, math.inf
    if cubic == 0.0:
        if quadratic != 0.0:
            first = -0.5 * linear / quadratic
    else:
        root = quadratic * quadratic - 3.0 * linear * cubic
        if root > 0.0:
            sum_ = -(quadratic + math.copysign(math.sqrt(root), quadratic))  # no cancellation
            first, second = sum_ / (3.0 * cubic), linear / sum_
    for turn in (first, second):
        if math.isfinite(turn):
            if turn <= near:
                low = max(low, turn)
            else:
                high = min(high, turn)
    return low, high


@njit(cache=True)
def _displacement(p: float, linear: float, quadratic: float, cubic: float) -> float:
    return p * (linear + p * (quadratic + p * cubic))


@njit(cache=True)
def _solve(wanted: float, low: float, high: float, start: float, law: tuple[float, float, float]) -> float:
    """P between `low` and `high` that gives `wanted`, or the nearer end: Newton's method in a bracket that shrinks."""
    linear, quadratic, cubic = law
    rises = _displacement(high, *law) > _displacement(low, *law)
    p = start
    for _ in range(_NEWTON_STEPS):
        miss = _displacement(p, *law) - wanted
        if (miss > 0.0) == rises:
            high = p
        else:
            low = p
        slope = linear + p * (2.0 * quadratic + 3.0 * cubic * p)
        ahead = p - miss / slope if slope != 0.0 else high
        if not low <= ahead <= high:
            ahead = 0.5 * (low + high)
        if abs(ahead - p) <= 1e-16 + 4e-16 * abs(p):
            return ahead
        p = ahead
    return p


@njit(cache=True)
def _invert(
    state: Array,
    wanted: Array,
    voltage: Array,
    found: Array,
    linear: float,
    quadratic: float,
    cubic: float,
    field: float,
) -> None:
    for k in range(wanted.size):
        near = state[_POLARIZATION] if state[_SEEN] != 0.0 else _POLED
        law = (linear + field * voltage[k], quadratic, cubic)
        low, high = _branch(near, *law)
        low, high = max(low, near - _FARTHEST), min(high, near + _FARTHEST)
        found[k] = _solve(wanted[k], low, high, near, law)
        if low + _NEXT_TO < found[k] < high - _NEXT_TO:  # the end of a branch does not say whose end it is
            state[_POLARIZATION] = found[k]
        elif state[_SEEN] == 0.0:
            state[_POLARIZATION] = near
        state[_SEEN], state[_VOLTAGE] = 1.0, voltage[k]
