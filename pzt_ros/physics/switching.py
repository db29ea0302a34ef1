"""Ceramics whose switching is stepped by compiled loops: what stands around the loops, written once."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Signals

QUASI_STATIC_RATE = 1e5
"""[V/m/s]; the slowest ramp of the thesis' experiments."""

FIELD_LIMIT = 1e7
"""The inverse looks for fields up to this [V/m]; a PZT layer breaks down before."""

INVERSE_TOLERANCE = 1e-10
"""Polarization by which the inverse may miss [C/m^2]."""


@dataclass(frozen=True, kw_only=True)
class Switching(Ferroelectric):
    """Voltage to polarization by a loop over samples that says which one it cannot use.

    State: last time [s], last voltage [V], dP/dV of the last inverted sample [C/(m^2 V)], then the model's own.
    """

    @property
    @abstractmethod
    def _state_size(self) -> int:
        """Numbers in a state."""

    _kernel: ClassVar[Any]
    """Module of the compiled loops: `run` and `run_inverse` move a state, fill the last two arrays they are given, and
    return the first sample that cannot be used, or whose time runs back, else -1."""

    @property
    @abstractmethod
    def _numbers(self) -> Any:
        """The model's parameters as the compiled loops take them."""

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage [V] to polarization [C/m^2] and phase fraction [-].

        Raises:
            BenchError: no voltage, a sample that is not finite, time that runs back, a foreign state.
        """
        self._check("voltage", signals.voltage, signals.time, state)
        after = state.copy()
        polarization, phase_fraction = self._run(after, signals.time, signals.voltage)
        return after, signals.replace(polarization=polarization, phase_fraction=phase_fraction)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization wanted [C/m^2] to the voltage [V] for which `step` gives it, within +-10 MV/m.

        A sample that asks for no finite polarization keeps the last voltage.

        Raises:
            BenchError: no polarization, time that runs back, a foreign state.
        """
        self._check("polarization", signals.polarization, signals.time, state)
        after = state.copy()
        voltage, phase_fraction = np.empty(signals.time.size), np.empty(signals.time.size)
        limits = FIELD_LIMIT * self.layer_thickness, INVERSE_TOLERANCE
        bad = self._kernel.run_inverse(
            after, self._numbers, signals.time, signals.polarization, voltage, phase_fraction, *limits
        )
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: time {signals.time[bad]:.9g} s at sample {bad} is not after the one before; sort it"
            )
        return after, signals.replace(voltage=voltage, phase_fraction=phase_fraction)

    def _check(self, name: str, values: Array, time: Array, state: State) -> None:
        """The compiled loops do not look where they read."""
        if values.size != time.size:
            raise BenchError(
                f"{self.kind}: the block has {values.size} values of {name} for {time.size} times;"
                f" put a link or a record that gives {name} before this one"
            )
        if state.size != self._state_size:
            raise BenchError(
                f"{self.kind}: the state has {state.size} numbers, this model has {self._state_size}; start from init()"
            )

    def _run(self, state: State, time: Array, voltage: Array) -> tuple[Array, Array]:
        polarization, phase_fraction = np.empty(time.size), np.empty(time.size)
        bad = self._kernel.run(state, self._numbers, time, voltage, polarization, phase_fraction)
        self._refuse(bad, time, voltage)
        return polarization, phase_fraction

    def _refuse(self, bad: int, time: Array, voltage: Array) -> None:
        """Name the sample that a loop could not use, if there was one."""
        if bad >= 0:
            raise BenchError(
                f"{self.kind}: sample {bad} ({time[bad]:.9g} s, {voltage[bad]:.6g} V) is not finite, beyond"
                " 1 GV/m, or not after the one before; drop or sort it"
            )
