"""Instruments that play a recorded run, sample by sample, as if it happened now.

What is asked of them changes nothing: voltage, current and displacement come from the record. At its end they hold the
last sample and say so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from pzt_ros.bags import load_run
from pzt_ros.errors import BenchError
from pzt_ros.hardware.amplifier import Applied
from pzt_ros.hardware.driver import AmplifierSettings, Bench, DriverError, SensorSettings
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import choice
from pzt_ros.records import Record

ROOM = 293.15
"""Temperature of a record that does not say it [K]."""
_TOLERANCE = 1e-3
"""A sample may stand this far from its place on the grid of the sample rate [samples]."""


@dataclass(frozen=True, kw_only=True)
class ReplayAmplifierSettings(AmplifierSettings):
    """Plays voltage and current of a record."""

    kind: ClassVar[str] = "replay"

    record: str = choice("", (), "run to play: a CSV file, a bag folder or an .mcap file")
    namespace: str = choice("/stage", (), "of the axis in a bag")

    def build(self, bench: Bench) -> ReplayAmplifier:
        """An amplifier that plays the record."""
        return ReplayAmplifier(self, bench.sample_rate)


@dataclass(frozen=True, kw_only=True)
class ReplaySensorSettings(SensorSettings):
    """Plays the displacement of a record."""

    kind: ClassVar[str] = "replay"

    record: str = choice("", (), "run to play: a CSV file, a bag folder or an .mcap file")
    namespace: str = choice("/stage", (), "of the axis in a bag")

    def build(self, bench: Bench) -> ReplaySensor:
        """A sensor that plays the record."""
        return ReplaySensor(self, bench.sample_rate)


class _Player:
    """A record on the grid of the sample rate; its first sample is played at time 0."""

    def __init__(self, path: str, namespace: str, sample_rate: float) -> None:
        self._path = path
        self._namespace = namespace
        self._rate = sample_rate
        self._record: Record | None = None
        self.remark = ""

    def open(self) -> None:
        """Read the record.

        Raises:
            BenchError: no record is named, it cannot be read, or is sampled otherwise than the graph.
        """
        if not self._path:
            raise BenchError("driver 'replay' needs a run to play: set the parameter replay.record")
        record = load_run(self._path, namespace=self._namespace)
        places = (record.time - record.time[0]) * self._rate
        off = np.flatnonzero(~(np.abs(places - np.arange(len(places))) <= _TOLERANCE))
        if off.size:
            median = 1.0 / float(np.median(np.diff(record.time)))
            raise BenchError(
                f"{record.name}: sampled at {median:.6g} Hz, sample {off[0] + 1} at {record.time[off[0]]:.9g} s; "
                f"replay needs the graph's {self._rate:.6g} Hz throughout: set sample_rate, or resample the run"
            )
        self._record = record

    def close(self) -> None:
        """Put the record away."""
        self._record = None

    @property
    def record(self) -> Record:
        """What is played."""
        if self._record is None:
            raise DriverError("replay: the record is not open; restart the node")
        return self._record

    def rows(self, time: Array) -> NDArray[np.intp]:
        """The samples that are played at run times [s]; the last one where the record is over."""
        last = len(self.record) - 1
        rows = np.rint(time * self._rate).astype(np.intp)
        if rows[-1] > last and not self.remark:
            self.remark = f"{self.record.name} is over after {last / self._rate:.6g} s: holding its last sample"
        return np.clip(rows, 0, last)


class ReplayAmplifier:
    """The amplifier of a recorded run.

    Its voltage cannot be brought to 0 V, because nothing is there: it stays what the record says until the driver is
    closed. A record without current reads as 0 A, one without temperature as room temperature; the charge is the
    integral of the current.
    """

    gain = 1.0

    def __init__(self, settings: ReplayAmplifierSettings, sample_rate: float) -> None:
        self._player = _Player(settings.record, settings.namespace, sample_rate)
        self._period = 1.0 / sample_rate
        self._current: Array = np.empty(0)
        self._charge: Array = np.empty(0)
        self._voltage = 0.0
        self._temperature: Array = np.empty(0)
        self.temperature = ROOM

    @property
    def remark(self) -> str:
        """That the record is over, once it is."""
        return self._player.remark

    @property
    def voltage(self) -> float:
        """Recorded voltage of the sample played last, at first that of the first one [V]; 0 when closed."""
        return self._voltage

    def open(self) -> None:
        """Read the record; raises `BenchError` as `_Player.open`."""
        self._player.open()
        record = self._player.record
        self._current = record.current if record.current is not None else np.zeros(len(record))
        self._charge = np.cumsum(self._current) * self._period
        self._voltage = float(record.voltage[0])
        self._temperature = record.temperature if record.temperature is not None else np.full(len(record), ROOM)
        self.temperature = float(self._temperature[0])

    def close(self) -> None:
        """Put the record away."""
        self._player.close()
        self._voltage = 0.0

    def warm_up(self) -> None:
        """There is nothing to compile."""

    def apply(self, time: Array, command_voltage: Array) -> Applied:
        """What the record says of these times; the command changes nothing."""
        rows = self._player.rows(time)
        voltage = self._player.record.voltage[rows]
        self._voltage = float(voltage[-1])
        self.temperature = float(self._temperature[rows[-1]])
        return Applied(time, voltage, self._current[rows], self._charge[rows])


class ReplaySensor:
    """The sensor of a recorded run."""

    def __init__(self, settings: ReplaySensorSettings, sample_rate: float) -> None:
        self._player = _Player(settings.record, settings.namespace, sample_rate)

    @property
    def remark(self) -> str:
        """That the record is over, once it is."""
        return self._player.remark

    def open(self) -> None:
        """Read the record; raises `BenchError` as `_Player.open`."""
        self._player.open()

    def close(self) -> None:
        """Put the record away."""
        self._player.close()

    def warm_up(self) -> None:
        """There is nothing to compile."""

    def read(self, time: Array, displacement: Array) -> Array:
        """What the record says of these times [m]."""
        rows = self._player.rows(time)
        return self._player.record.displacement[rows]
