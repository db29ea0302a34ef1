"""Current limit of the amplifier where the record has only the command, into the ceramic as it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from pzt_ros.effects.rate_limit import RateLimit, rate_of
from pzt_ros.errors import BenchError
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import ACTUATOR, State, no_state
from pzt_ros.physics.loaded import Loaded
from pzt_ros.physics.signals import Array, Rest, Signals
from pzt_ros.physics.switching import INVERSE_TOLERANCE
from pzt_ros.quantities import parameter

_TIME, _POLARIZATION, _HEAD = 0, 1, 2
_FEWEST, _MOST = 4, 256  # samples that are tried at once
_SLACK = 10.0 * INVERSE_TOLERANCE  # of P [C/m^2], beyond what the ceramic's inverse may miss
_FREE = 0.0  # way of a voltage that is not held back


class _Part(NamedTuple):
    """What the first of some samples came to.

    Attributes:
        state: after them.
        voltage: at them [V, shape (n,)].
        way: of the next one: free, or held back on the way up (1) or down (-1).
    """

    state: State
    voltage: Array
    way: float


@dataclass(frozen=True, kw_only=True)
class AmplifierChargeLimit(Loaded):
    """The voltage follows the command as fast as the largest current charges the ceramic: |dP/dt| <= I/A.

    Where the ceramic switches, most of its charge is polarization that switches, and its capacitance is many times that
    of other places. A turn of the command that the voltage did not reach is no turn of the ceramic: so the link runs a
    copy of it, which says where the voltage is that the current has led to.
    """

    kind: ClassVar[str] = "amplifier_charge_limit"
    section: ClassVar[str] = ACTUATOR

    inverse_current_density: float = parameter(
        0.0, "m^2/A", "electrode area over largest current; 0 for no limit", symbol="A/I", bounds=(0.0, 1e3)
    )

    @property
    def feels_load(self) -> bool:
        """Whether there is a limit."""
        return self.inverse_current_density > 0.0

    @property
    def fastest(self) -> float:
        """Largest rate of the polarization [C/(m^2 s)]."""
        return rate_of(self.inverse_current_density)

    @property
    def shortcut(self) -> ChargeRate:
        """The polarization of the command, later: the same as long as a leg goes one way."""
        return ChargeRate(fastest=self.fastest)

    def init(self, rest: Rest) -> State:
        """Last time [s] and P [C/m^2], then the ceramic's state.

        Raises:
            BenchError: a limit without a ceramic behind it.
        """
        if not self.feels_load:
            return no_state()
        memory = self._ceramic.init(rest)
        here = Signals(time=np.array([rest.time]), voltage=np.array([rest.voltage]))
        memory, out = self._ceramic.step(memory, here)
        return _state(here.time, out.polarization, memory)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Command to the voltage that the current has led to, at the samples."""
        if not self.feels_load:
            return state, signals.replace(voltage=signals.voltage.copy())
        time, command = signals.time, signals.voltage
        reached = np.empty_like(command)
        first, way, size = 0, _FREE, _FEWEST
        while first < time.size:
            tried = slice(first, first + size)
            found = (self._held if way else self._free)(state, time[tried], command[tried], way)
            if way and size == _FEWEST and not found.voltage.size:  # a ceramic whose P falls with the voltage
                found = self._taken(state, time[first : first + 1], command[first : first + 1])
            reached[first : first + found.voltage.size] = found.voltage
            size = min(2 * size, _MOST) if found.way == way else _FEWEST
            state, way, first = found.state, found.way, first + found.voltage.size
        return state, signals.replace(voltage=reached)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """What is wanted behind the limit, asked for as it is: more cannot be had."""
        return self.step(state, signals)[0], signals

    @property
    def _ceramic(self) -> Ferroelectric:
        if self.load is None:
            raise BenchError(f"{self.kind}: the chain has no ceramic that it could charge; add one behind it")
        return self.load

    def _taken(self, state: State, time: Array, command: Array) -> _Part:
        """As the command goes, whatever that takes."""
        memory, out = self._ceramic.step(state[_HEAD:], Signals(time=time, voltage=command))
        return _Part(_state(time, out.polarization, memory), command, _FREE)

    def _free(self, state: State, time: Array, command: Array, way: float) -> _Part:
        """As the command goes, up to the first sample that takes more charge than the current brings."""
        memory, out = self._ceramic.step(state[_HEAD:], Signals(time=time, voltage=command))
        change = np.diff(out.polarization, prepend=state[_POLARIZATION])
        steps = np.diff(time, prepend=state[_TIME])
        beyond = np.flatnonzero((np.abs(change) > self.fastest * steps + _SLACK) & (steps > 0.0))
        if not beyond.size:
            return _Part(_state(time, out.polarization, memory), command, way)
        good, next_way = beyond[0], math.copysign(1.0, change[beyond[0]])
        if good == 0:
            return _Part(state, command[:0], next_way)
        return self._free(state, time[:good], command[:good], way)._replace(way=next_way)

    def _held(self, state: State, time: Array, command: Array, way: float) -> _Part:
        """As fast as the current allows, up (1) or down (-1), up to the first sample at which the command is met."""
        rises = way * self.fastest * np.diff(time, prepend=state[_TIME])
        polarization = np.cumsum([state[_POLARIZATION], *rises])[1:]  # one by one, the same wherever blocks are cut
        memory, out = self._ceramic.invert(state[_HEAD:], Signals(time=time, polarization=polarization))
        met = np.flatnonzero(way * (command - out.voltage) <= 0.0)
        if not met.size:
            return _Part(_state(time, polarization, memory), out.voltage, way)
        if met[0] == 0:
            return _Part(state, command[:0], _FREE)
        return self._held(state, time[: met[0]], command[: met[0]], way)._replace(way=_FREE)


def _state(time: Array, polarization: Array, memory: State) -> State:
    return np.concatenate(([time[-1], polarization[-1]], memory))


@dataclass(frozen=True, kw_only=True)
class ChargeRate(RateLimit):
    """The polarization follows that of the command no faster than a rate."""

    kind: ClassVar[str] = "charge_rate"
    section: ClassVar[str] = ACTUATOR
    limited: ClassVar[str] = "polarization"

    fastest: float = math.inf  # [C/(m^2 s)]
