"""What an amplifier has to offer, and the simulated one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numba import njit

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import AMPLIFIER
from pzt_ros.physics.signals import REHEARSAL, Array, Rest, Signals


@dataclass(frozen=True)
class Applied:
    """What the amplifier did and measured over a block [each of shape (n,)].

    Attributes:
        time: sample times [s].
        voltage: across the ceramic [V].
        current: into the ceramic [A].
        charge: on the ceramic since the start, from the Sawyer-Tower capacitor [C].
    """

    time: Array
    voltage: Array
    current: Array
    charge: Array


class AmplifierDriver(Protocol):
    """The slot for a real amplifier or DAQ output.

    The guard stands before it: what arrives here is finite, of the right shape, inside window and slew rate. Whatever
    fails raises `BenchError` with one line within a bounded time, and the guard makes it a fault; while that lasts it
    asks for `voltage` again and again, which is where a driver reconnects.
    """

    @property
    def remark(self) -> str:
        """What the person at the bench should know now; empty most of the time."""

    def open(self) -> None:
        """Connect, and see that it is the instrument that was meant; nothing is put out."""

    def close(self) -> None:
        """Bring the stack to 0 V if it still can be reached, and let go; never raises, and may be called again."""

    def apply(self, time: Array, command_voltage: Array) -> Applied:
        """Put out a block of command voltage [V] and say what happened."""

    @property
    def voltage(self) -> float:
        """Voltage found at the stack now [V]."""

    @property
    def gain(self) -> float:
        """Voltage across the ceramic over command voltage [-]."""

    def warm_up(self) -> None:
        """Get ready for the first block without putting anything out."""


@runtime_checkable
class Thermometer(Protocol):
    """An amplifier driver that also measures a temperature, of itself or of the stack."""

    @property
    def temperature(self) -> float:
        """Last one known [K]; asked for often, so it does not wait for the instrument."""


class SimulatedAmplifier:
    """The amplifier of the chain with its load: the ceramic, whose switching draws the current.

    It runs the ferroelectric link a second time, beside the plant's, because current and charge are measured here.
    """

    remark = ""

    def __init__(self, chain: Chain, rest: Rest) -> None:
        self._amplifier = chain.section(AMPLIFIER)
        self.gain = math.prod(getattr(link, "gain", 1.0) for link in self._amplifier.links)
        ceramic = tuple(link for link in chain.links if isinstance(link, Ferroelectric))
        self._load = Chain(chain.name, ceramic)
        self._area = sum(link.electrode_area for link in ceramic)
        self._amplifier_state = self._amplifier.init(rest)
        self._load_state = self._load.init(rest)
        self._time = rest.time
        self._voltage = rest.voltage
        self._charge = 0.0
        self._polarization_start = self._polarization_at_rest(rest)

    def _polarization_at_rest(self, rest: Rest) -> float:
        here = Signals(time=np.array([rest.time]), voltage=np.array([rest.voltage]))
        _, signals = self._load.step(self._load_state, here)
        return float(signals.polarization[0]) if signals.polarization.size else 0.0

    def warm_up(self) -> None:
        """Compile now what the first block would have to wait for; the state stays as it is."""
        _, driven = self._amplifier.step(self._amplifier_state, Signals(REHEARSAL, np.zeros_like(REHEARSAL)))
        self._load.step(self._load_state, driven)
        _current(REHEARSAL, REHEARSAL, 0.0, 0.0)

    def open(self) -> None:
        """There is nothing to connect to."""

    def close(self) -> None:
        """Its relay discharges the stack."""
        self._voltage = 0.0

    @property
    def voltage(self) -> float:
        """Voltage across the ceramic after the last sample [V]."""
        return self._voltage

    def apply(self, time: Array, command_voltage: Array) -> Applied:
        """Run a block through amplifier and load."""
        self._amplifier_state, driven = self._amplifier.step(self._amplifier_state, Signals(time, command_voltage))
        self._load_state, loaded = self._load.step(self._load_state, driven)
        polarization = loaded.polarization if loaded.polarization.size else np.zeros_like(time)
        charge = self._area * (polarization - self._polarization_start)
        current = _current(time, charge, self._time, self._charge)
        self._time, self._charge, self._voltage = float(time[-1]), float(charge[-1]), float(driven.voltage[-1])
        return Applied(time, driven.voltage, current, charge)


@njit(cache=True)
def _current(time: Array, charge: Array, last_time: float, last_charge: float) -> Array:
    """Mean current of each sample step [A]; 0 where a step takes no time."""
    current = np.zeros_like(time)
    for i in range(len(time)):
        elapsed = time[i] - last_time
        if elapsed > 0.0:
            current[i] = (charge[i] - last_charge) / elapsed
        last_time, last_charge = time[i], charge[i]
    return current
