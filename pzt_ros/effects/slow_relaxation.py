"""Slow relaxation of the structure: creep that follows the displacement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.sampling import lag_gains, other_step
from pzt_ros.physics.change import Change, Columns
from pzt_ros.physics.link import ACTUATOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_BRANCHES = 5
_SEEN, _TIME, _INPUT, _STEP, _HEAD = 0, 1, 2, 3, 4


@dataclass(frozen=True, kw_only=True)
class SlowRelaxation(Link):
    """A part of the displacement comes late: y + share * weighted mean of five lags of y, log-spaced over a band.

    Kelvin-Voigt elements in series, as glue, electrodes and clamping give them; five alike make a creep that is nearly
    a straight line over log time, all of it at the `ends` makes two elements. The link starts in balance wherever its
    first sample is.
    """

    kind: ClassVar[str] = "slow_relaxation"
    section: ClassVar[str] = ACTUATOR
    remembers: ClassVar[bool] = True

    share: float = parameter(0.0, "1", "late displacement over prompt displacement", bounds=(0.0, 1.0))
    shortest_time: float = parameter(0.1, "s", "fastest time constant of the band", bounds=(1e-5, 1e5))
    longest_time: float = parameter(10.0, "s", "slowest time constant of the band", bounds=(1e-5, 1e5))
    ends: float = parameter(0.0, "1", "share that only the fastest and slowest have; even without", bounds=(0.0, 1.0))
    tilt: float = parameter(0.0, "1", "how much more the slowest has than the middle", bounds=(-1.0, 1.0))

    @property
    def weights(self) -> Array:
        """Late displacement of each lag over prompt displacement [-]."""
        place = np.linspace(-1.0, 1.0, _BRANCHES)
        shares = np.full(_BRANCHES, (1.0 - self.ends) / _BRANCHES)
        shares[[0, -1]] += 0.5 * self.ends
        return np.asarray(self.share * shares * (1.0 + self.tilt * place))

    @property
    def times(self) -> Array:
        """Time constants of the lags [s]."""
        return np.geomspace(self.shortest_time, self.longest_time, _BRANCHES)

    def init(self, rest: Rest) -> State:
        """Whether a sample was seen; time [s], displacement in [m], last step [s]; output of each lag [m]."""
        return np.zeros(_HEAD + _BRANCHES)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Prompt displacement to displacement."""
        after, out = state.copy(), np.empty_like(signals.displacement)
        _relax(after, signals.time, signals.displacement, out, self.times, self.weights)
        return after, signals.replace(displacement=out)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The change with a part of it that comes late: the link is linear."""
        out = np.empty_like(change.displacement, order="C")
        _relax_columns(signals.time, change.displacement, out, self.times, self.weights)
        return replace(change, displacement=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement wanted to prompt displacement; exact."""
        after, needed = state.copy(), np.empty_like(signals.displacement)
        _unrelax(after, signals.time, signals.displacement, needed, self.times, self.weights)
        return after, signals.replace(displacement=needed)


@njit(cache=True)
def _set_gains(gains: Array, step: float, times: Array) -> None:
    for j in range(_BRANCHES):
        gains[j, 0], gains[j, 1], gains[j, 2] = lag_gains(step, times[j])


@njit(cache=True)
def _begin(state: Array, time: float, displacement: float) -> None:
    state[_SEEN], state[_TIME], state[_INPUT] = 1.0, time, displacement
    state[_HEAD:] = displacement


@njit(cache=True)
def _relax(state: Array, time: Array, prompt: Array, out: Array, times: Array, weights: Array) -> None:
    gains = np.empty((_BRANCHES, 3))
    _set_gains(gains, state[_STEP], times)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], prompt[k])
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            _set_gains(gains, step, times)
        late = 0.0
        for j in range(_BRANCHES):
            z = gains[j, 0] * state[_HEAD + j] + gains[j, 1] * state[_INPUT] + gains[j, 2] * prompt[k]
            state[_HEAD + j] = z
            late += weights[j] * z
        state[_TIME], state[_INPUT] = time[k], prompt[k]
        out[k] = prompt[k] + late


@njit(cache=True)
def _relax_columns(time: Array, prompt: Columns, out: Columns, times: Array, weights: Array) -> None:
    """`_relax` for many columns at once, which differ in their input only."""
    gains, late = np.empty((_BRANCHES, 3)), np.empty((_BRANCHES, prompt.shape[1]))
    for j in range(_BRANCHES):
        late[j] = prompt[0]
    out[0] = (1.0 + weights.sum()) * prompt[0]
    known = 0.0
    for k in range(1, time.size):
        step = time[k] - time[k - 1]
        if other_step(step, known):
            known = step
            _set_gains(gains, step, times)
        for i in range(prompt.shape[1]):
            before, now = prompt[k - 1, i], prompt[k, i]
            total = 0.0
            for j in range(_BRANCHES):
                z = gains[j, 0] * late[j, i] + gains[j, 1] * before + gains[j, 2] * now
                late[j, i] = z
                total += weights[j] * z
            out[k, i] = now + total


@njit(cache=True)
def _unrelax(state: Array, time: Array, wanted: Array, prompt: Array, times: Array, weights: Array) -> None:
    gains = np.empty((_BRANCHES, 3))
    _set_gains(gains, state[_STEP], times)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k] / (1.0 + weights.sum()))
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            _set_gains(gains, step, times)
        known, prompt_gain = 0.0, 1.0
        for j in range(_BRANCHES):
            known += weights[j] * (gains[j, 0] * state[_HEAD + j] + gains[j, 1] * state[_INPUT])
            prompt_gain += weights[j] * gains[j, 2]
        prompt[k] = (wanted[k] - known) / prompt_gain
        for j in range(_BRANCHES):
            state[_HEAD + j] = gains[j, 0] * state[_HEAD + j] + gains[j, 1] * state[_INPUT] + gains[j, 2] * prompt[k]
        state[_TIME], state[_INPUT] = time[k], prompt[k]
