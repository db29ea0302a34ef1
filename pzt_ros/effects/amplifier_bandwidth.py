"""Bandwidth of the amplifier where the record has only the command."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.sampling import lag_gains, other_step
from pzt_ros.physics.linear_response import lag_inverse
from pzt_ros.physics.link import AMPLIFIER, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_SEEN, _TIME, _INPUT, _OUTPUT, _STEP, _SIZE = 0, 1, 2, 3, 4, 5


@dataclass(frozen=True, kw_only=True)
class AmplifierBandwidth(Link):
    """A first-order lag between the command and the voltage across the ceramic, in balance at the first sample."""

    kind: ClassVar[str] = "amplifier_bandwidth"
    section: ClassVar[str] = AMPLIFIER

    time_constant: float = parameter(0.0, "s", "of the lag", bounds=(0.0, 10.0))

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; time [s], voltage in and out [V], last step [s]."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Command to voltage."""
        after, out = state.copy(), np.empty_like(signals.voltage)
        _follow(after, signals.time, signals.voltage, out, self.time_constant)
        return after, signals.replace(voltage=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage wanted to command.

        Exact where sampling is slower than the time constant, else by differences: first order in the step.
        """
        after, command = state.copy(), np.empty_like(signals.voltage)
        _lead(after, signals.time, signals.voltage, command, self.time_constant)
        return after, signals.replace(voltage=command)


@njit(cache=True)
def _begin(state: Array, time: float, voltage: float) -> None:
    state[_SEEN], state[_TIME], state[_INPUT], state[_OUTPUT] = 1.0, time, voltage, voltage


@njit(cache=True)
def _follow(state: Array, time: Array, command: Array, out: Array, time_constant: float) -> None:
    kept, first, last = lag_gains(state[_STEP], time_constant)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], command[k])
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            kept, first, last = lag_gains(step, time_constant)
        state[_OUTPUT] = kept * state[_OUTPUT] + first * state[_INPUT] + last * command[k]
        state[_TIME], state[_INPUT], out[k] = time[k], command[k], state[_OUTPUT]


@njit(cache=True)
def _lead(state: Array, time: Array, wanted: Array, command: Array, time_constant: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k])
        command[k] = wanted[k]
        if time_constant > 0.0:
            step = time[k] - state[_TIME]
            command[k] = lag_inverse(wanted[k], state[_OUTPUT], state[_INPUT], step, time_constant)
        state[_TIME], state[_INPUT], state[_OUTPUT] = time[k], command[k], wanted[k]
