"""From polarization to displacement where strain over polarization is a loop (thesis 2.2.2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.change import Change, Columns, scaled
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _POLARIZATION, _TURNS = 0, 1, 2


@dataclass(frozen=True, kw_only=True)
class StrainHysteresis(Link):
    """Strain as the square of a polarization that leads: S = zeta (P + delta s)^2; stands in place of electrostriction.

    A reversal by 180 degrees is two steps of 90 degrees (thesis 2.2.2, its reference 48). It is the 90-degree steps
    that strain, and they come first: over the first stretch after a turn of the polarization strain changes by more
    than its share, until as many domains leave the intermediate state as enter it. So strain is that of a polarization
    ahead by delta, up or down. The sign s runs from -1 to 1 with P over the turn width and stays there until P turns
    (the stop operator, the complement of the play operator): rate-independent, as the thesis saw it at 0.1 and 1 Hz.
    With delta = 0 the link is electrostriction to the bit.
    """

    kind: ClassVar[str] = "strain_hysteresis"
    section: ClassVar[str] = ACTUATOR
    follows_turns: ClassVar[bool] = True

    coefficient: float = parameter(0.02293, "m^4/C^2", "strain over P^2", symbol="zeta", bounds=(1e-6, 1e3))
    active_length: float = parameter(8e-3, "m", "layers times their thickness", bounds=(1e-6, 1.0))
    polarization_lead: float = parameter(
        0.0, "C/m^2", "polarization by which strain is ahead; 0 for no loop", symbol="delta", bounds=(0.0, 1.0)
    )
    turn_width: float = parameter(
        0.05, "C/m^2", "change of P after a turn until strain is ahead again", symbol="w", bounds=(1e-6, 10.0)
    )

    def init(self, rest: Rest) -> State:
        """See `begun`."""
        return begun(1)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization to displacement."""
        after, leading = state.copy(), np.empty_like(signals.straining)
        lead(after, signals.straining, leading, *self._shape)
        return after, signals.replace(displacement=self.coefficient * self.active_length * leading**2)

    def carry(self, signals: Signals, change: Change) -> Change:
        """Twice the leading polarization times its change."""
        leading = np.empty_like(signals.straining)
        lead(begun(1), signals.straining, leading, *self._shape)
        slope = 2.0 * self.coefficient * self.active_length * leading
        ahead = lead_of_change(signals.straining, change.straining, *self._shape)
        return replace(change, displacement=scaled(slope, ahead))

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement to polarization, on the positive branch that a poled actuator works on."""
        square = signals.displacement / (self.coefficient * self.active_length)
        leading = np.sqrt(np.maximum(square, 0.0))
        after, polarization = state.copy(), np.empty_like(leading)
        unlead(after, leading, polarization, *self._shape)
        return after, signals.replace(polarization=polarization, strain_polarization=polarization)

    @property
    def _shape(self) -> tuple[Array, Array]:
        return stops(self.polarization_lead, np.array([self.turn_width]))


def begun(count: int) -> State:
    """Whether a sample was seen, the last P [C/m^2], and of each turn width how far the turn has come [C/m^2]."""
    return np.zeros(_TURNS + count)


def stops(polarization_lead: float, widths: Array) -> tuple[Array, Array]:
    """How much strain leads per turn [-] and how far a turn goes to both sides [C/m^2], for each of some widths."""
    return 2.0 * polarization_lead / (widths * widths.size), 0.5 * widths


@njit(cache=True)
def lead(state: Array, polarization: Array, leading: Array, gains: Array, most: Array) -> None:
    """The polarization that is ahead by `gains` times how far the turns have come, at the `most` that far [C/m^2]."""
    for k in range(polarization.size):
        change = polarization[k] - state[_POLARIZATION] if state[_SEEN] else 0.0
        state[_SEEN], state[_POLARIZATION] = 1.0, polarization[k]
        leading[k] = polarization[k]
        for i in range(most.size):
            state[_TURNS + i] = min(max(state[_TURNS + i] + change, -most[i]), most[i])
            leading[k] += gains[i] * state[_TURNS + i]


def lead_of_change(polarization: Array, change: Columns, gains: Array, most: Array) -> Columns:
    """What changes of the polarization change of the leading one, from the first sample on [shape (n, p)]."""
    out = np.empty_like(change, order="C")
    _lead_columns(polarization, change, out, gains, most)
    return out


@njit(cache=True)
def _lead_columns(polarization: Array, change: Columns, out: Columns, gains: Array, most: Array) -> None:
    """The tangent of `lead`: a turn that has come as far as it goes no longer changes."""
    turns, moved = np.zeros(most.size), np.zeros((most.size, change.shape[1]))
    out[0] = change[0]
    for k in range(1, polarization.size):
        step = polarization[k] - polarization[k - 1]
        out[k] = change[k]
        for j in range(most.size):
            turns[j] += step
            if abs(turns[j]) >= most[j]:
                turns[j] = min(max(turns[j], -most[j]), most[j])
                moved[j] = 0.0
                continue
            for i in range(change.shape[1]):
                moved[j, i] += change[k, i] - change[k - 1, i]
                out[k, i] += gains[j] * moved[j, i]


@njit(cache=True)
def _change(turns: Array, wanted: float, gains: Array, most: Array) -> float:
    """By how much P changes so that the leading polarization changes by as much as wanted.

    From turn to turn that ends on the way, the leading polarization goes straight: 1 + the gains of those that go on.
    """
    sign = 1.0 if wanted >= 0.0 else -1.0
    left, change = abs(wanted), 0.0
    while True:
        slope, room = 1.0, math.inf
        for i in range(most.size):
            ahead = most[i] - sign * turns[i] - change
            if ahead > 0.0:
                slope += gains[i]
                room = min(room, ahead)
        if left <= slope * room:
            return float(sign * (change + left / slope))
        change += room
        left -= slope * room


@njit(cache=True)
def unlead(state: Array, leading: Array, polarization: Array, gains: Array, most: Array) -> None:
    """The exact inverse of `lead`."""
    turns = state[_TURNS:]
    for k in range(leading.size):
        change = 0.0
        if state[_SEEN]:
            change = _change(turns, leading[k] - state[_POLARIZATION] - np.sum(gains * turns), gains, most)
        polarization[k] = leading[k]
        for i in range(most.size):
            turns[i] = min(max(turns[i] + change, -most[i]), most[i])
            polarization[k] -= gains[i] * turns[i]
        state[_SEEN], state[_POLARIZATION] = 1.0, polarization[k]
