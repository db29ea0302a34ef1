"""Drivers for piezo controllers that speak PI's General Command Set 2.0 over TCP (E-709, E-727, E-753, E-754 and kin).

Software-timed: every sample is a command of its own, so the sample rate is that of the conversation, a few hundred per
second. docs/hardware.md tells what was tried, and with what.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pzt_ros.errors import BenchError
from pzt_ros.hardware.amplifier import Applied
from pzt_ros.hardware.driver import AmplifierSettings, Bench, DriverError, SensorSettings
from pzt_ros.hardware.gcs import PORT, GcsConnection
from pzt_ros.physics.signals import Array
from pzt_ros.quantities import choice, parameter

_CLOSING_STEP = 0.01
"""When a driver is closed with voltage on the stack, it comes down in steps of this length [s]."""
_POLLS_KEPT = 100_000
_WHEN_IN_TROUBLE = 0.05
"""A controller that does not answer is not asked in a busy loop [s]."""
_SHORTEST, _LOST_PERIODS = 0.9, 5.0
"""Samples follow each other by no less than this share of a period; a lateness of so many periods is not made up."""


@dataclass(frozen=True, kw_only=True)
class _Controller:
    """Where a controller is, and how long it may take."""

    host: str = choice("", (), "IP address of the controller; a name has to be looked up, which no timeout bounds")
    port: float = parameter(float(PORT), "1", "TCP port of the controller", bounds=(1.0, 65_535.0))
    timeout: float = parameter(0.2, "s", "longest wait for an answer", bounds=(1e-3, 10.0))

    def connection(self, retry_after: float = 1.0) -> GcsConnection:
        """To it, not connected yet.

        Raises:
            BenchError: no address was given.
        """
        if not self.host:
            raise BenchError("driver 'gcs' needs the address of the controller: set the parameter gcs.host")
        return GcsConnection(self.host, int(self.port), self.timeout, retry_after)


@dataclass(frozen=True, kw_only=True)
class GcsAmplifierSettings(_Controller, AmplifierSettings):
    """One axis of a controller in open loop: the voltage is commanded with SVA and read back with VOL?."""

    kind: ClassVar[str] = "gcs"

    axis: str = choice("1", (), "axis that SVA and SVO act on")
    channel: str = choice("1", (), "output channel that VOL? reads")
    volts_per_unit: float = parameter(
        1.0, "V", "voltage at the stack for one unit of SVA; see the controller's manual", bounds=(1e-6, 1e4)
    )
    tolerance: float = parameter(
        10.0, "V", "largest difference of VOL? from what was commanded, at the end of a block", bounds=(1e-3, 1e3)
    )
    capacitance: float = parameter(
        0.0, "F", "of the stack, to tell the current from VOL?; 0: current reads as 0 A", bounds=(0.0, 1e-2)
    )
    closing_rate: float = parameter(
        500.0, "V/s", "rate of the way to 0 V when the driver is closed with voltage on the stack", bounds=(1.0, 1e5)
    )

    def build(self, bench: Bench) -> GcsAmplifier:
        """The driver, not connected yet."""
        return GcsAmplifier(self, bench.sample_rate)


@dataclass(frozen=True, kw_only=True)
class GcsSensorSettings(_Controller, SensorSettings):
    """The position of one axis of a controller, asked for with POS? as often as it answers."""

    kind: ClassVar[str] = "gcs"

    axis: str = choice("1", (), "axis that POS? reads")
    metres_per_unit: float = parameter(1e-6, "m", "displacement for one unit of POS?", bounds=(1e-12, 1.0))
    pause: float = parameter(1e-3, "s", "between an answer to POS? and the next question", bounds=(0.0, 1.0))
    oldest: float = parameter(0.1, "s", "a reading older than this is no measurement any more", bounds=(1e-3, 10.0))

    def build(self, bench: Bench) -> GcsSensor:
        """The driver, not connected yet."""
        return GcsSensor(self)


def _identify(connection: GcsConnection) -> str:
    """Who answers there; clears the controller's error, too.

    Raises:
        DriverError: nobody, or no PI controller.
    """
    (identity, *_), _ = connection.exchange("*IDN?", "ERR?")
    if "physik instrumente" not in identity.lower():
        connection.close()
        raise DriverError(f"{connection.name} is no PI controller, it says '{identity[:60]}'; check host and port")
    return identity


class GcsAmplifier:
    """One axis of a controller as an amplifier.

    Samples go out one by one at their times. After a late one the next may follow a tenth of a period sooner, no more,
    so that on the wall clock the guard's slew rate is never exceeded by more than that; a lateness of many periods is
    not made up at all, and the run is slower by it.
    """

    def __init__(self, settings: GcsAmplifierSettings, sample_rate: float) -> None:
        self.gain = settings.volts_per_unit
        self.remark = ""
        self._settings = settings
        self._connection = settings.connection()
        self._period = 1.0 / sample_rate
        self._due = 0.0
        self._voltage = 0.0
        self._charge = 0.0
        self._closed = True

    def open(self) -> None:
        """Connect, switch the axis to open loop, and ask for its limits; nothing moves.

        Raises:
            DriverError: no answer, no PI controller, or the axis cannot be switched.
        """
        self._closed = False
        self._connection.allow_attempt()
        identity = self._prepare()
        found = self._voltage
        limits = [self._limit(question) for question in ("VMI?", "VMA?")]
        self.remark = f"{identity}; {found:.2f} V at the stack; controller limits {limits[0]} to {limits[1]} V"
        if not self._settings.capacitance:
            self.remark += "; current is not measured and reads as 0 A"

    def close(self) -> None:
        """Bring the stack to 0 V at the closing rate, if it answers, and let go."""
        if self._closed:
            return
        self._closed = True
        try:
            if self._connection.connected:
                self._come_down()
        except BenchError as error:
            self.remark = f"closed with {self._voltage:.2f} V at the stack: {error}"
        finally:
            self._connection.close()

    def warm_up(self) -> None:
        """There is nothing to compile."""

    @property
    def voltage(self) -> float:
        """What VOL? says now [V]; 0 after a close that brought it there. Reconnects if the connection was lost.

        Raises:
            DriverError: the controller does not answer.
        """
        if self._closed:
            return self._voltage
        if not self._connection.connected:
            self._prepare()
        else:
            self._voltage = self._connection.number("VOL?", self._settings.channel)
        return self._voltage

    def apply(self, time: Array, command_voltage: Array) -> Applied:
        """Send every sample at its time and read the voltage back.

        Raises:
            DriverError: no answer, an error of the controller, or a voltage that is not what was asked for.
        """
        if self._closed or not self._connection.connected:
            raise DriverError(f"controller {self._connection.name} is not connected")
        before = self._voltage
        voltage = np.array([self._send(command) for command in command_voltage])
        wanted = float(command_voltage[-1]) * self.gain
        if abs(voltage[-1] - wanted) > self._settings.tolerance:
            raise DriverError(
                f"controller {self._connection.name} has {voltage[-1]:.2f} V where {wanted:.2f} V were asked for, more "
                f"than {self._settings.tolerance:g} V apart; check volts_per_unit, the channel and the stack"
            )
        charges = self._charge + self._settings.capacitance * (voltage - before)
        current = np.diff(charges, prepend=self._charge) / self._period
        self._charge = float(charges[-1])
        return Applied(time, voltage, current, charges)

    def _prepare(self) -> str:
        """Connect, open loop, and the voltage found; who answers there. A connection that is not ready is dropped."""
        axis, channel = self._settings.axis, self._settings.channel
        try:
            self._connection.connect()
            identity = _identify(self._connection)
            (answer,) = self._connection.tell(f"SVO {axis} 0", f"VOL? {channel}")
            self._voltage = self._connection.number("VOL?", channel, answer)
        except DriverError:
            self._connection.close()
            raise
        return identity

    def _limit(self, question: str) -> str:
        """A limit of the output channel; not every controller tells."""
        limit = self._connection.number_if_known(question, self._settings.channel)
        return "unknown" if limit is None else f"{limit:g}"

    def _send(self, command: float) -> float:
        """One sample at its time; the voltage read back [V]."""
        wait = self._due - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
        self._due = self._next_due(time.monotonic())
        channel = self._settings.channel
        (answer,) = self._connection.tell(f"SVA {self._settings.axis} {command:.6f}", f"VOL? {channel}")
        self._voltage = self._connection.number("VOL?", channel, answer)
        return self._voltage

    def _next_due(self, now: float) -> float:
        if now - self._due > _LOST_PERIODS * self._period:
            return now + self._period
        return max(self._due + self._period, now + _SHORTEST * self._period)

    def _come_down(self) -> None:
        period, self._period = self._period, _CLOSING_STEP
        step = self._settings.closing_rate * _CLOSING_STEP / self.gain
        command = self._voltage / self.gain
        try:
            while command:
                command = np.sign(command) * max(abs(command) - step, 0.0)
                self._send(float(command))
        finally:
            self._period = period  # it may be opened again


class GcsSensor:
    """The position of one axis, asked for all the time by a thread of its own.

    A reading cannot be had for a time that is over, so the thread keeps what it has read with the wall clock's time,
    and a block that was just put out is given, sample by sample, the last reading before it. What lies between the
    end of the block and its arrival here is a delay of the measurement.
    """

    def __init__(self, settings: GcsSensorSettings) -> None:
        self.remark = ""
        self._settings = settings
        self._connection = settings.connection(retry_after=0.2)
        self._readings: deque[tuple[float, float]] = deque(maxlen=_POLLS_KEPT)
        self._trouble = ""
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Connect, read once, and begin to ask.

        Raises:
            DriverError: no answer, no PI controller, or no position.
        """
        self._connection.allow_attempt()
        self.remark = self._connect()
        self._read()
        self._stop.clear()
        self._thread = threading.Thread(target=self._ask_on, name=f"gcs-sensor-{self._connection.name}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop asking and let go."""
        self._stop.set()
        self._connection.close()
        if self._thread is not None:
            self._thread.join(self._settings.timeout + 1.0)
            self._thread = None
        self._connection.close()  # the thread may just have connected anew

    def warm_up(self) -> None:
        """There is nothing to compile."""

    def read(self, time: Array, displacement: Array) -> Array:
        """The readings [m] for a block that has just been put out: the last one before each sample.

        Raises:
            DriverError: there is no reading young enough.
        """
        now = _now()
        wanted = now - (time[-1] - time)
        stamps, values = self._readings_since(float(wanted[0]))
        if self._thread is None or not stamps.size:
            raise DriverError(f"controller {self._connection.name} is not read; open the driver first")
        if now - stamps[-1] > self._settings.oldest:
            why = self._trouble or "the controller answers too slowly"
            raise DriverError(f"last reading is {now - stamps[-1]:.2f} s old, limit {self._settings.oldest:g} s: {why}")
        return values[np.maximum(np.searchsorted(stamps, wanted, side="right") - 1, 0)]

    # -- inside

    def _readings_since(self, begin: float) -> tuple[Array, Array]:
        """Times [s, wall clock] and displacements [m] of the readings since `begin`, and the one before it."""
        with self._lock:
            while len(self._readings) > 1 and self._readings[1][0] <= begin:
                self._readings.popleft()
            pairs = np.array(self._readings).reshape(-1, 2)
        return pairs[:, 0], pairs[:, 1]

    def _connect(self) -> str:
        self._connection.connect()
        return _identify(self._connection)

    def _read(self) -> None:
        position = self._connection.number("POS?", self._settings.axis)
        with self._lock:
            self._readings.append((_now(), position * self._settings.metres_per_unit))

    def _ask_on(self) -> None:
        while not self._stop.is_set():
            self._trouble = self._ask_once()
            self._stop.wait(_WHEN_IN_TROUBLE if self._trouble else self._settings.pause)

    def _ask_once(self) -> str:
        """One reading; what is in the way, or nothing."""
        try:
            if not self._connection.connected:
                self._connect()
            self._read()
        except BenchError as error:
            return str(error)
        return ""


def _now() -> float:
    return time.monotonic()
