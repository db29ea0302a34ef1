"""A signal that follows another no faster than at a largest rate: what the two current limits share."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.physics.link import Link, State
from pzt_ros.physics.signals import Array, Rest, Signals

_SEEN, _TIME, _COMMAND, _OUTPUT, _SIZE = 0, 1, 2, 3, 4


class RateLimit(Link):
    """One signal follows itself at a largest rate; the inverse asks for the signal itself, more cannot be had."""

    limited: ClassVar[str]
    """Name of the signal."""

    @property
    @abstractmethod
    def fastest(self) -> float:
        """Largest rate of it [unit of the signal per s]; infinite for no limit."""

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; time [s], the signal before and behind the limit."""
        return np.zeros(_SIZE)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """The signal behind the limit; exact at the samples for one of straight lines."""
        after, wanted = state.copy(), getattr(signals, self.limited)
        out = np.empty_like(wanted)
        _limit(after, signals.time, wanted, out, self.fastest)
        return after, signals.replace(**{self.limited: out})

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """What is wanted behind the limit, asked for as it is."""
        wanted = getattr(signals, self.limited)
        return self.step(state, signals)[0], signals.replace(**{self.limited: wanted.copy()})


def rate_of(inverse: float) -> float:
    """One over it; infinite for 0."""
    return 1.0 / inverse if inverse > 0.0 else math.inf


@njit(cache=True)
def _after(behind: float, command: float, rate: float, step: float, fastest: float) -> float:
    """Output at the end of a `step` [s] in which the command, `behind` ahead, went on at `rate` to `command`.

    The output goes towards the command as fast as it may until both meet, then follows it as well as it can.
    """
    if behind != 0.0:
        closing = fastest - math.copysign(rate, rate * behind)
        if closing * step <= abs(behind):
            return command - math.copysign(abs(behind) - closing * step, behind)
        step -= abs(behind) / closing
    too_fast = max(abs(rate) - fastest, 0.0) * step
    return command - math.copysign(too_fast, rate)


@njit(cache=True)
def _limit(state: Array, time: Array, command: Array, out: Array, fastest: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            state[_SEEN], state[_TIME], state[_COMMAND], state[_OUTPUT] = 1.0, time[k], command[k], command[k]
        step = time[k] - state[_TIME]
        if fastest == math.inf or step <= 0.0:
            state[_OUTPUT] = command[k] if fastest == math.inf else state[_OUTPUT]
        else:
            rate = (command[k] - state[_COMMAND]) / step
            state[_OUTPUT] = _after(state[_COMMAND] - state[_OUTPUT], command[k], rate, step, fastest)
        state[_TIME], state[_COMMAND], out[k] = time[k], command[k], state[_OUTPUT]
