"""Charge that leaks through the ceramic and is measured as polarization."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.change import Change
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _VOLTAGE, _CHARGE, _SIZE = 0, 1, 2, 3, 4


@dataclass(frozen=True, kw_only=True)
class Leakage(Link):
    """Polarization as charge measures it: P plus the integral of the leakage current density.

    The link stands behind the strain, so that it changes the polarization that is recorded and nothing else. With the
    field E = U/h the current density is conductivity times E; the parameter is conductivity over layer thickness, which
    is all that a record of voltage and polarization can say.
    """

    kind: ClassVar[str] = "leakage"
    section: ClassVar[str] = ACTUATOR

    areal_conductance: float = parameter(0.0, "S/m^2", "conductivity over layer thickness", bounds=(0.0, 1e3))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; its time [s] and voltage [V]; charge that has leaked so far [C/m^2]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization to polarization as recorded."""
        after, leaked = self._leaked(state, signals)
        return after, signals.replace(polarization=signals.polarization + leaked)

    def carry(self, signals: Signals, change: Change) -> Change:
        """As it comes in."""
        return change

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization as recorded to polarization; exact.

        On the way back from a displacement neither polarization nor voltage is known yet; then there is nothing to do.
        """
        if signals.polarization.size == 0 or signals.voltage.size == 0:
            return state, signals
        after, leaked = self._leaked(state, signals)
        return after, signals.replace(polarization=signals.polarization - leaked)

    def _leaked(self, state: State, signals: Signals) -> tuple[State, Array]:
        after, leaked = state.copy(), np.empty_like(signals.voltage)
        _integrate(after, signals.time, signals.voltage, leaked, self.areal_conductance)
        return after, leaked


@njit(cache=True)
def _integrate(state: Array, time: Array, voltage: Array, leaked: Array, conductance: float) -> None:
    """The trapezoidal rule, which is exact for straight lines between samples."""
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            state[_SEEN], state[_TIME], state[_VOLTAGE] = 1.0, time[k], voltage[k]
        state[_CHARGE] += 0.5 * conductance * (voltage[k] + state[_VOLTAGE]) * (time[k] - state[_TIME])
        state[_TIME], state[_VOLTAGE], leaked[k] = time[k], voltage[k], state[_CHARGE]
