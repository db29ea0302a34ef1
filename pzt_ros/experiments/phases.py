"""The phases a scenario is made of: what is asked of the stage as a function of time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import choice, parameter
from pzt_ros.records import read_csv
from pzt_ros.reference import DISPLACEMENT, VOLTAGE


@dataclass(frozen=True, kw_only=True)
class Phase(ABC):
    """A stretch of a scenario; it starts where the phase before it ended."""

    kind: ClassVar[str]
    quantity: ClassVar[str]

    @property
    @abstractmethod
    def length(self) -> float:
        """Duration [s]."""

    @abstractmethod
    def value(self, start: float, time: Array) -> Array:
        """What is asked [V or m, shape (n,)] at `time` [s] after the phase began, from the value `start`."""


@dataclass(frozen=True, kw_only=True)
class VoltageRamp(Phase):
    """The drive voltage goes to a value, as half a sine or linearly (thesis, appendix B)."""

    kind: ClassVar[str] = "voltage"
    quantity: ClassVar[str] = VOLTAGE

    to: float = parameter(None, "V", "voltage at the end", bounds=(-1000.0, 1000.0))
    duration: float = parameter(
        None, "s", "time to get there; the voltage is held if it is there already", bounds=(1e-6, 1e5)
    )
    shape: str = choice("half-sine", ("half-sine", "linear"), "how the voltage gets there")

    @property
    def length(self) -> float:
        """Duration [s]."""
        return self.duration

    def value(self, start: float, time: Array) -> Array:
        """Drive voltage [V]."""
        part = np.clip(time / self.duration, 0.0, 1.0)
        if self.shape == "half-sine":
            part = 0.5 * (1.0 - np.cos(np.pi * part))
        return start + (self.to - start) * part


@dataclass(frozen=True, kw_only=True)
class Move(Phase):
    """The displacement goes to a value along half a sine."""

    kind: ClassVar[str] = "move"
    quantity: ClassVar[str] = DISPLACEMENT

    to: float = parameter(None, "m", "displacement at the end", bounds=(-1.0, 1.0))
    duration: float = parameter(None, "s", "time to get there", bounds=(1e-6, 1e5))
    controller: str = choice("", (), "controller to switch to; none keeps the one that is active")

    @property
    def length(self) -> float:
        """Duration [s]."""
        return self.duration

    def value(self, start: float, time: Array) -> Array:
        """Displacement [m]."""
        part = 0.5 * (1.0 - np.cos(np.pi * np.clip(time / self.duration, 0.0, 1.0)))
        return start + (self.to - start) * part


@dataclass(frozen=True, kw_only=True)
class Scan(Phase):
    """A periodic scan that starts at its lowest displacement, and ends there after whole cycles."""

    kind: ClassVar[str] = "scan"
    quantity: ClassVar[str] = DISPLACEMENT

    low: float = parameter(None, "m", "lowest displacement", bounds=(-1.0, 1.0))
    peak_to_peak: float = parameter(None, "m", "stroke of the scan", bounds=(0.0, 1.0))
    frequency: float = parameter(None, "Hz", "cycles per second", bounds=(1e-4, 1e4))
    cycles: float = parameter(None, "1", "how many cycles", bounds=(0.0, 1e6))
    shape: str = choice("triangle", ("triangle", "sine"), "wave form")
    controller: str = choice("", (), "controller to switch to; none keeps the one that is active")

    @property
    def length(self) -> float:
        """Duration [s]."""
        return self.cycles / self.frequency

    def value(self, start: float, time: Array) -> Array:
        """Displacement [m]."""
        cycle = np.clip(time * self.frequency, 0.0, self.cycles) % 1.0
        part = 1.0 - np.abs(1.0 - 2.0 * cycle) if self.shape == "triangle" else 0.5 * (1.0 - np.cos(2 * np.pi * cycle))
        return self.low + self.peak_to_peak * part


@dataclass(frozen=True, kw_only=True)
class FromFile(Phase):
    """The displacement of a CSV file (time_s, and reference_m or displacement_m), linear between its rows.

    It begins at its first row, whenever that was, and holds its last.
    """

    kind: ClassVar[str] = "file"
    quantity: ClassVar[str] = DISPLACEMENT

    path: str = choice("", (), "CSV file; a relative path starts at the scenario's folder")
    controller: str = choice("", (), "controller to switch to; none keeps the one that is active")

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        """Times from the first row on [s], and displacements [m]."""
        record = read_csv(self.path, required=("time_s",))
        places = record.reference if record.reference is not None else record.columns.get("displacement_m")
        if places is None:
            raise BenchError(f"{self.path}: neither reference_m nor displacement_m is among its columns; name one so")
        return record.time - record.time[0], places

    @property
    def length(self) -> float:
        """Duration [s]."""
        return float(self._rows[0][-1])

    def value(self, start: float, time: Array) -> Array:
        """Displacement [m]."""
        return np.interp(time, *self._rows)


PHASES: dict[str, type[Phase]] = {phase.kind: phase for phase in (VoltageRamp, Move, Scan, FromFile)}
"""Every phase a scenario may name; a new one is one line here."""
