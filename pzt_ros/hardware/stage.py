"""The simulated stage and the simulated sensor: what the plant and sensor nodes hold when there is no hardware."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pzt_ros.physics.chain import Chain
from pzt_ros.physics.link import ACTUATOR, SENSOR
from pzt_ros.physics.signals import ABSENT, REHEARSAL, Array, Rest, Signals
from pzt_ros.quantities import parameter


@dataclass(frozen=True)
class Truth:
    """What really happens in the simulated stage [each of shape (n,)].

    Attributes: time [s], displacement [m], polarization P [C/m^2], phase fraction x+ [-].
    """

    time: Array
    displacement: Array
    polarization: Array
    phase_fraction: Array


@dataclass(frozen=True, kw_only=True)
class Relay:
    """The discharge relay of the amplifier's own electronics (thesis 2.1: relays, 10 kOhm)."""

    resistance: float = parameter(10e3, "ohm", "resistor the stack is discharged through", bounds=(1.0, 1e7))
    capacitance: float = parameter(0.8e-6, "F", "of the stack", bounds=(1e-12, 1e-2))
    delay: float = parameter(
        2.5, "s", "no sign of life of the amplifier (1 Hz when it holds), on the wall clock, before the relay falls",
        bounds=(1.5, 60.0),
    )  # fmt: skip


class SimulatedStage:
    """The ceramic and the structure: voltage in, true displacement out."""

    def __init__(self, chain: Chain, rest: Rest) -> None:
        self._chain = chain.section(ACTUATOR)
        self._state = self._chain.init(rest)

    def step(self, time: Array, voltage: Array, neighbour: Array = ABSENT) -> Truth:
        """Advance by a block of drive voltage [V], beside an axis that is at `neighbour` [m], where there is one."""
        self._state, out = self._chain.step(self._state, Signals(time, voltage, neighbour=neighbour))
        return Truth(time, out.displacement, out.polarization, out.phase_fraction)

    def discharge(self, time: Array, voltage: float, relay: Relay) -> tuple[Truth, float]:
        """One block of the stack left alone at `voltage` [V], the relay's resistor across it.

        Also returns the voltage left [V]; below a millivolt the stack counts as empty.
        """
        elapsed = (time[1] - time[0]) * np.arange(1, len(time) + 1)
        left = voltage * np.exp(-elapsed / (relay.resistance * relay.capacitance))
        left[np.abs(left) < 1e-3] = 0.0
        return self.step(time, left), float(left[-1])

    def warm_up(self) -> None:
        """Compile now what the first block would have to wait for; the state stays as it is."""
        self._chain.step(self._state, Signals(REHEARSAL, np.zeros_like(REHEARSAL)))


class SensorDriver(Protocol):
    """The slot for a real displacement sensor; what fails raises `BenchError` with one line, in bounded time."""

    @property
    def remark(self) -> str:
        """What the person at the bench should know now; empty most of the time."""

    def open(self) -> None:
        """Connect, and see that it is the instrument that was meant."""

    def close(self) -> None:
        """Let go; never raises, and may be called again."""

    def warm_up(self) -> None:
        """Get ready for the first block."""

    def read(self, time: Array, displacement: Array) -> Array:
        """The readings [m] at the sample times; only a simulated sensor looks at the true `displacement` [m]."""


class SimulatedSensor:
    """The sensor links of the chain: true displacement in, reading out."""

    remark = ""

    def __init__(self, chain: Chain, rest: Rest) -> None:
        self._chain = chain.section(SENSOR)
        self._state = self._chain.init(rest)

    def open(self) -> None:
        """There is nothing to connect to."""

    def close(self) -> None:
        """There is nothing to let go."""

    def warm_up(self) -> None:
        """Compile now what the first block would have to wait for; the state stays as it is."""
        self._chain.step(self._state, Signals(REHEARSAL, displacement=np.zeros_like(REHEARSAL)))

    def read(self, time: Array, displacement: Array) -> Array:
        """The readings [m] at the sample times."""
        self._state, out = self._chain.step(self._state, Signals(time, displacement=displacement))
        return out.displacement
