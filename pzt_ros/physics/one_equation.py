"""Ceramics of one ODE (thesis 3.3): what its models have in common around their compiled loops."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.ferroelectric import Ferroelectric
from pzt_ros.physics.finite import first_not_finite
from pzt_ros.physics.link import State
from pzt_ros.physics.signals import Array, Signals
from pzt_ros.quantities import parameter

RAMP_TO_REST = 1.0
"""Duration of the ramp from the state before the run to a voltage at rest [s]."""


@dataclass(frozen=True, kw_only=True)
class OneEquation(Ferroelectric):
    """Voltage to polarization by one ODE; time may stand still or run back, the field then jumps."""

    _kernel: ClassVar[Any]
    """Module of the compiled loop `run`, which moves a state and fills the last two arrays it is given."""
    _inverse: ClassVar[Any]
    """Module of `run_inverse`, likewise."""

    temperature: float = parameter(
        293.0,
        "K",
        "Temperature of thermal activation.",
        symbol="T",
        bounds=(1.0, 2000.0),
    )
    domain_volume: float = parameter(
        1e-22,
        "m^3",
        "Volume that switches at once.",
        symbol="V_D",
        bounds=(1e-27, 1e-15),
    )
    accuracy: float = parameter(
        1e-6,
        "1",
        "Local error of the phase fraction allowed per step of the integration.",
        bounds=(1e-12, 1e-2),
    )

    @property
    @abstractmethod
    def material(self) -> Any:
        """The numbers as the compiled loops take them."""

    @cached_property
    def _numbers(self) -> tuple[float, ...]:
        return tuple(self.material)

    def step(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Polarization and phase fraction at the samples; the field is linear between them, however far apart.

        A sample at the time of the last one is a jump of the field.

        Raises:
            BenchError: a time or voltage is missing or no finite number.
        """
        voltage = self._finite(signals.voltage, signals.time.size, "voltage", "V")
        after = state.copy()
        p, x = self._run(after, self._finite(signals.time, signals.time.size, "time", "s"), voltage)
        return after, signals.replace(polarization=p, phase_fraction=x)

    def invert(self, state: State, signals: Signals) -> tuple[State, Signals]:
        """Voltage, linear between samples, with which `step` gives the polarization asked for at the samples.

        The field stays within +-10 MV/m; a target that is no number keeps the voltage where it was.

        Raises:
            BenchError: a time or the polarization is missing, or a time is no finite number.
        """
        if signals.polarization.size != signals.time.size:
            raise BenchError(
                f"{self.kind}: the block has {signals.time.size} samples,"
                f" but {signals.polarization.size} of polarization to invert; give one for each"
            )
        time = self._finite(signals.time, signals.time.size, "time", "s")
        target = np.ascontiguousarray(signals.polarization, dtype=np.float64)
        after, voltage, x = state.copy(), np.empty(time.size), np.empty(time.size)
        self._inverse.run_inverse(after, self._numbers, time, target, voltage, x)
        return after, signals.replace(voltage=voltage, phase_fraction=x)

    def _run(self, state: State, time: Array, voltage: Array) -> tuple[Array, Array]:
        p, x = np.empty(time.size), np.empty(time.size)
        self._kernel.run(state, self._numbers, time, voltage, p, x)
        return p, x

    def _ramp_to(self, state: State, voltage: float) -> None:
        """From the state before the run to a voltage at rest [V], in place."""
        if voltage != 0.0:
            self._run(state, np.array([state[0] + RAMP_TO_REST]), np.array([float(voltage)]))

    def _finite(self, values: Array, count: int, name: str, unit: str) -> Array:
        if values.size != count:
            raise BenchError(
                f"{self.kind}: the block has {count} samples, but {values.size} of {name}; give one for each"
            )
        array = np.ascontiguousarray(values, dtype=np.float64)
        first = first_not_finite(array)
        if first >= 0:
            raise BenchError(f"{self.kind}: {name} is {array[first]} {unit} at sample {first}; give finite numbers")
        return array


def decaying_drive(amplitude: float, layer_thickness: float, samples: int) -> tuple[Array, Array]:
    """The thesis' pre-run A sin(20 pi t)(1 - t), 0 to 1 s, that leaves a virgin state.

    Args:
        amplitude: A [V/m].
        layer_thickness: [m].
        samples: how many.

    Returns:
        Times [s] and voltages [V, shape (samples,)].
    """
    time = np.linspace(0.0, 1.0, samples)
    return time, amplitude * np.sin(20 * np.pi * time) * (1 - time) * layer_thickness
