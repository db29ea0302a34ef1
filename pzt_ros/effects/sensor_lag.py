"""A reading that comes late: delay and bandwidth of the sensor."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from pzt_ros.effects.sampling import lag_gains, other_step
from pzt_ros.physics.change import Change, Columns
from pzt_ros.physics.linear_response import lag_inverse, lag_step
from pzt_ros.physics.link import SENSOR, Link, State
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.quantities import parameter

_MOST = 1000
"""Samples that can be under way. Once half of them are, those closer than 1/500 of the delay are left out."""

_SEEN, _TIME, _INPUT, _OUTPUT, _STEP, _OLDEST, _COUNT, _HEAD = 0, 1, 2, 3, 4, 5, 6, 7
_ROW = 3
"""What is kept of a sample under way: time, input and the output of the lag."""


@dataclass(frozen=True, kw_only=True)
class SensorLag(Link):
    """A first-order lag, then a delay of any length; together as late as `lag` says, where the input is a ramp.

    Both are exact for straight lines between samples, however uneven. The link starts in balance wherever its first
    sample is.
    """

    kind: ClassVar[str] = "sensor_lag"
    section: ClassVar[str] = SENSOR

    lag: float = parameter(0.0, "s", "delay and time constant together", bounds=(0.0, 1.0))
    delay_share: float = parameter(1.0, "1", "part of it that is delay, the rest is bandwidth", bounds=(0.0, 1.0))

    def prompt(self) -> SensorLag:
        """Without lag and delay."""
        return dataclasses.replace(self, lag=0.0) if self.lag > 0.0 else self

    @property
    def pure_delay(self) -> float:
        """[s]."""
        return self.lag * self.delay_share

    @property
    def time_constant(self) -> float:
        """Of the lag [s]."""
        return self.lag * (1.0 - self.delay_share)

    def init(self, rest: Rest) -> State:
        """The last sample (seen or not, time [s], in and out [m], step [s]) and a ring of those under way."""
        return np.zeros(_HEAD + (_ROW * (_MOST + 2) if self.pure_delay > 0.0 else 0))

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Displacement to reading."""
        after, out = state.copy(), np.empty_like(signals.displacement)
        _follow(after, signals.time, signals.displacement, out, self.time_constant, self.pure_delay)
        return after, signals.replace(displacement=out)

    def carry(self, signals: Signals, change: Change) -> Change:
        """The change, as late: the link is linear."""
        out = np.empty_like(change.displacement, order="C")
        _follow_columns(signals.time, change.displacement, out, self.time_constant, self.pure_delay)
        return dataclasses.replace(change, displacement=out)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Reading wanted to displacement; nobody can undo the delay.

        The bandwidth is undone exactly where sampling is slower than its time constant, else by differences: first
        order in the step.
        """
        after, needed = state.copy(), np.empty_like(signals.displacement)
        _lead(after, signals.time, signals.displacement, needed, self.time_constant, self.pure_delay)
        return after, signals.replace(displacement=needed)


@njit(cache=True)
def _begin(state: Array, time: float, displacement: float, delay: float) -> None:
    state[_SEEN], state[_TIME], state[_INPUT], state[_OUTPUT] = 1.0, time, displacement, displacement
    if delay > 0.0:
        state[_HEAD], state[_HEAD + 1], state[_HEAD + 2], state[_COUNT] = time, displacement, displacement, 1.0


@njit(cache=True)
def _place(state: Array, number: int) -> int:
    """Where the sample under way with that number, counted from the oldest, stands in the ring."""
    return _HEAD + _ROW * ((int(state[_OLDEST]) + number) % (_MOST + 2))


@njit(cache=True)
def _delayed(state: Array, time_constant: float, delay: float) -> float:
    """Keep the last sample and say what comes out of the delay now: the lag's output a delay ago."""
    count, now = int(state[_COUNT]), state[_TIME]
    newest = _place(state, count - 1)
    gap = now - state[newest]
    if gap > 0.0 and (count < _MOST // 2 or gap >= 2.0 * delay / _MOST):
        newest = _place(state, count)
        state[newest], state[newest + 1], state[newest + 2] = now, state[_INPUT], state[_OUTPUT]
        count += 1
    then = now - delay
    while count > 1 and state[_place(state, 1)] <= then:
        state[_OLDEST] = (int(state[_OLDEST]) + 1) % (_MOST + 2)
        count -= 1
    state[_COUNT] = count
    old = _place(state, 0)
    time, before, output = state[old], state[old + 1], state[old + 2]
    if then <= time:
        return output
    next_time, next_input = now, state[_INPUT]
    if count > 1:
        new = _place(state, 1)
        next_time, next_input = state[new], state[new + 1]
    there = before + (next_input - before) * (then - time) / (next_time - time)
    if time_constant == 0.0:
        return there
    return lag_step(output, before, there, then - time, time_constant)


@njit(cache=True)
def _follow(state: Array, time: Array, displacement: Array, out: Array, time_constant: float, delay: float) -> None:
    kept, first, last = lag_gains(state[_STEP], time_constant)
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], displacement[k], delay)
        step = time[k] - state[_TIME]
        if other_step(step, state[_STEP]):
            state[_STEP] = step
            kept, first, last = lag_gains(step, time_constant)
        state[_OUTPUT] = kept * state[_OUTPUT] + first * state[_INPUT] + last * displacement[k]
        state[_TIME], state[_INPUT] = time[k], displacement[k]
        out[k] = _delayed(state, time_constant, delay) if delay > 0.0 else state[_OUTPUT]


@njit(cache=True)
def _follow_columns(time: Array, free: Columns, out: Columns, time_constant: float, delay: float) -> None:
    """`_follow` for many columns at once, which differ in their input only."""
    lagged = np.empty_like(free) if delay > 0.0 else out
    lagged[0], known = free[0], 0.0
    kept, first, last = lag_gains(known, time_constant)
    for k in range(1, time.size):
        step = time[k] - time[k - 1]
        if other_step(step, known):
            known = step
            kept, first, last = lag_gains(step, time_constant)
        for i in range(free.shape[1]):
            lagged[k, i] = kept * lagged[k - 1, i] + first * free[k - 1, i] + last * free[k, i]
    if delay > 0.0:
        _delay_columns(time, free, lagged, out, time_constant, delay)


@njit(cache=True)
def _delay_columns(
    time: Array, free: Columns, lagged: Columns, out: Columns, time_constant: float, delay: float
) -> None:
    """What came out of the lag a delay ago, for many columns at once; between samples exact for straight lines."""
    before = 0
    for k in range(time.size):
        then = time[k] - delay
        while before + 1 < time.size and time[before + 1] <= then:
            before += 1
        if then <= time[before]:
            out[k] = lagged[before]
            continue
        step = time[before + 1] - time[before]
        part = (then - time[before]) / step
        kept, first, last = lag_gains(part * step, time_constant)
        for i in range(free.shape[1]):
            start, there = free[before, i], free[before, i] + part * (free[before + 1, i] - free[before, i])
            out[k, i] = kept * lagged[before, i] + first * start + last * there


@njit(cache=True)
def _lead(state: Array, time: Array, wanted: Array, needed: Array, time_constant: float, delay: float) -> None:
    for k in range(time.size):
        if state[_SEEN] == 0.0:
            _begin(state, time[k], wanted[k], delay)
        needed[k] = wanted[k]
        if time_constant > 0.0:
            step = time[k] - state[_TIME]
            needed[k] = lag_inverse(wanted[k], state[_OUTPUT], state[_INPUT], step, time_constant)
        state[_TIME], state[_INPUT], state[_OUTPUT] = time[k], needed[k], wanted[k]
        if delay > 0.0:
            _delayed(state, time_constant, delay)
