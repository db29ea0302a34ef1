"""Between the stack and the point that moves: a flexure with its mode, and what pushes back."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.linear_response import mode_inverse, mode_inverse_settles, mode_step
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _INPUT, _POSITION, _VELOCITY, _SIZE = 0, 1, 2, 3, 4, 5


@dataclass(frozen=True, kw_only=True)
class Structure(Link):
    """Free displacement of the stack to the displacement of what it carries.

    A load of stiffness k_L leaves k_A/(k_A + k_L) of the free displacement; a mode of static gain 1 comes on top. The
    link starts at rest wherever its first sample is.
    """

    kind: ClassVar[str] = "structure"
    section: ClassVar[str] = ACTUATOR

    resonance_frequency: float = parameter(
        0.0, "Hz", "undamped frequency of the mode; 0 for a rigid structure", symbol="f_0", bounds=(0.0, 1e7)
    )
    damping_ratio: float = parameter(0.02, "1", "damping of the mode over critical", symbol="D", bounds=(0.0, 0.95))
    load_stiffness: float = parameter(0.0, "N/m", "stiffness of the load", symbol="k_L", bounds=(0.0, 1e12))
    actuator_stiffness: float = parameter(1e8, "N/m", "stiffness of the stack", symbol="k_A", bounds=(1.0, 1e12))

    def prompt(self) -> Structure:
        """Without the mode."""
        return dataclasses.replace(self, resonance_frequency=0.0) if self.resonance_frequency > 0.0 else self

    def inverse_looks_back(self, step: float) -> bool:
        """Where sampling is fast against the mode."""
        moves = self.resonance_frequency > 0.0
        return moves and not mode_inverse_settles(step, self._frequency, self.damping_ratio)

    @property
    def static_gain(self) -> float:
        """Displacement over free displacement, at rest [-]."""
        return self.actuator_stiffness / (self.actuator_stiffness + self.load_stiffness)

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen, then time [s], free displacement [m], position [m] and velocity [m/s]."""
        return np.zeros(_SIZE if self.resonance_frequency > 0.0 else 0)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Free displacement to displacement."""
        after, moved = state, signals.displacement
        if self.resonance_frequency > 0.0:
            after, moved = state.copy(), np.empty_like(signals.displacement)
            _follow(after, signals.time, signals.displacement, moved, self._frequency, self.damping_ratio)
        return after, signals.replace(displacement=self.static_gain * moved)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to free displacement; exact where sampling is slow against the mode.

        Where it is fast, the mode's inverse amplifies without bound whatever is between two samples; then velocity and
        acceleration are differences of the displacement wanted.
        """
        after, needed = state, signals.displacement / self.static_gain
        if self.resonance_frequency > 0.0:
            after, wanted = state.copy(), needed
            needed = np.empty_like(wanted)
            _lead(after, signals.time, wanted, needed, self._frequency, self.damping_ratio)
        return after, signals.replace(displacement=needed)

    @property
    def _frequency(self) -> float:
        return 2.0 * math.pi * self.resonance_frequency


@njit(cache=True)
def _begin(state: Array, time: float, position: float) -> None:
    """At rest at the first sample."""
    state[_SEEN], state[_TIME], state[_INPUT], state[_POSITION] = 1.0, time, position, position


@njit(cache=True)
def _follow(state: Array, time: Array, free: Array, out: Array, frequency: float, damping: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], free[k])
        state[_POSITION], state[_VELOCITY] = mode_step(
            state[_POSITION], state[_VELOCITY], state[_INPUT], free[k], time[k] - state[_TIME], frequency, damping
        )
        state[_TIME], state[_INPUT], out[k] = time[k], free[k], state[_POSITION]


@njit(cache=True)
def _lead(state: Array, time: Array, wanted: Array, out: Array, frequency: float, damping: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k])
        out[k], state[_VELOCITY] = mode_inverse(
            wanted[k], state[_POSITION], state[_VELOCITY], state[_INPUT], time[k] - state[_TIME], frequency, damping
        )
        state[_TIME], state[_INPUT], state[_POSITION] = time[k], out[k], wanted[k]
