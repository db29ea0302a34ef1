"""What the amplifier notices of the run around it: silence, a sensor that is lost or stuck, a second sender."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from pzt_ros.hardware import machine
from pzt_ros.hardware.amplifier import Applied, Thermometer
from pzt_ros.hardware.block_figures import Travel, travel
from pzt_ros.hardware.guard import ENABLED, GuardedAmplifier
from pzt_ros.physics.signals import Array

_BLOCKS_KEPT = 4096
"""So many blocks of applied voltage may wait for the measurement that goes with them."""

_OPEN_PATH = 20.0
"""The voltage moves by so much, up and down [V], before a stack is said to take no charge."""


class Watch:
    """Tells the guard what it has seen; times are of a wall clock that never runs back [s], those of blocks of the run.

    What is still said of blocks from before the amplifier was enabled does not count.

    A reading is stuck if it stays the same to the bit while the voltage of the blocks before it moves by more than the
    limit. A sensor is lost if a block was put out and no measurement of it or a later one comes; a graph without a
    sensor (`expects_sensor` false) has none to lose.
    """

    def __init__(self, amplifier: GuardedAmplifier, expects_sensor: bool = True) -> None:
        self.amplifier = amplifier
        self._expects_sensor = expects_sensor
        self._last_command = 0.0
        self._late: deque[bool] = deque()
        self._owed: deque[tuple[float, float]] = deque(maxlen=_BLOCKS_KEPT)
        self._waiting: deque[tuple[float, float, float]] = deque(maxlen=_BLOCKS_KEPT)
        self.restart(0.0)

    def restart(self, now: float) -> None:
        """The amplifier was enabled: what was before does not count."""
        self._last_command = now
        amplifier = self.amplifier
        self._begin = (amplifier.next_block * amplifier.block_size - 0.5) / amplifier.sample_rate
        self._late.clear()
        self._owed.clear()
        self._waiting.clear()
        self._path, self._charged, self._last_voltage = 0.0, 0.0, math.nan
        self._reading = math.nan
        self._lowest, self._highest = math.inf, -math.inf

    def age(self, now: float) -> float:
        """How long ago the last command was put out [s]."""
        return now - self._last_command

    def paced(self, age: float, period: float) -> None:
        """A command came `age` [s] after the block before it, where one is due every `period` [s]."""
        limits = self.amplifier.limits
        late = age > limits.late_after * period
        self._late.append(late)
        while len(self._late) > limits.late_window:
            self._late.popleft()
        if not late:
            return
        self.amplifier.counts["late commands"] += 1
        found = sum(self._late)
        if found >= limits.late_commands > 0.0:
            longest = 1e3 * limits.late_after * period
            self.amplifier.trip(
                machine.LATE,
                f"{found} of the last {len(self._late)} commands came more than {longest:g} ms after the block before, "
                f"limit {limits.late_commands:g} of {limits.late_window:g}",
            )

    def put_out(self, applied: Applied, now: float) -> None:
        """A command was put out."""
        self._last_command = now
        begin = float(applied.time[0])
        if self._expects_sensor:
            self._owed.append((begin, now))
        went = travel(applied.voltage, applied.current, self._last_voltage)
        self._waiting.append((begin, went.lowest, went.highest))
        self._last_voltage = float(applied.voltage[-1])
        self._connected(went, float(applied.time[1] - applied.time[0]))

    def _connected(self, went: Travel, period: float) -> None:
        """A stack that is there takes charge when the voltage moves."""
        self._path += went.path
        self._charged += went.current * period
        if self._path < _OPEN_PATH:
            return
        found, limit = self._charged / self._path, self.amplifier.limits.capacitance_min
        self._path, self._charged = 0.0, 0.0
        if found < limit:
            self.amplifier.trip(
                machine.OPEN_STACK,
                f"the stack takes {1e9 * found:.3g} nC a volt, limit {1e9 * limit:.3g} nC; is it connected?",
            )

    def measured(self, first_time: float, displacement: Array) -> None:
        """The sensor says a block of readings [m] that starts at `first_time` [s]."""
        while self._owed and self._owed[0][0] <= first_time:
            self._owed.popleft()
        if not first_time >= self._begin:
            return
        if not np.isfinite(displacement).all():
            self.amplifier.trip(machine.SENSOR_NOT_FINITE, "the sensor's reading is not a finite number")
            return
        if not (displacement == self._reading).all():
            self._reading = float(displacement[-1])
            self._lowest, self._highest = math.inf, -math.inf
            while self._waiting and self._waiting[0][0] < first_time:
                self._waiting.popleft()
            return
        # the block measured now does not count yet: its voltage may have moved in the last sample
        while self._waiting and self._waiting[0][0] < first_time:
            _, low, high = self._waiting.popleft()
            self._lowest, self._highest = min(self._lowest, low), max(self._highest, high)
        moved, limit = self._highest - self._lowest, self.amplifier.limits.stuck_voltage
        if moved > limit:
            self.amplifier.trip(
                machine.SENSOR_STUCK,
                f"the sensor stays at {1e6 * self._reading:.4f} um while the voltage moved by {moved:.1f} V, "
                f"limit {limit:.1f} V",
            )

    def estimated(self, first_time: float, innovation: Array) -> None:
        """The observer says by how much the readings of a block differ from what it expected [m]."""
        if not first_time >= self._begin:
            return
        differences, limit = np.abs(innovation), self.amplifier.limits.discrepancy
        if differences.max() <= limit:  # and so is the median, which takes twenty times as long
            return
        difference = float(np.median(differences))
        if not math.isfinite(difference):  # the observer may say so before the sensor does
            self.amplifier.trip(machine.SENSOR_NOT_FINITE, "a reading, or what was expected, is not a finite number")
        elif not difference <= limit:
            self.amplifier.trip(
                machine.DISCREPANCY,
                f"sensor and observer differ by {1e6 * difference:.3f} um, limit {1e6 * limit:.3f} um",
            )

    def senders(self, count: int) -> None:
        """So many publishers are on the topic of the commands."""
        reason = f"{count} publishers on the topic of the commands, one is allowed" if count > 1 else ""
        self.amplifier.present(machine.SENDERS, reason)

    def temperature(self) -> None:
        """Ask a driver that measures a temperature; what is too hot stays a cause until it has cooled down."""
        driver = self.amplifier.driver
        if not isinstance(driver, Thermometer):  # at every look, for a driver may have one only once it is open
            return
        found, limit = driver.temperature, self.amplifier.limits.temperature
        hot = "" if found <= limit else f"temperature of {found:.1f} K, limit {limit:.1f} K"
        self.amplifier.present(machine.OVER_TEMPERATURE, hot)

    def unmeasured(self, now: float) -> float:
        """For how long the oldest block that was put out has not been measured [s]."""
        return now - self._owed[0][1] if self._owed else 0.0

    def look(self, now: float) -> None:
        """Time has passed: who should have said something by now?"""
        if self.amplifier.state != ENABLED:
            return
        limits = self.amplifier.limits
        unmeasured = self.unmeasured(now)
        if unmeasured > limits.longest_unmeasured:
            self.amplifier.trip(
                machine.SENSOR_LOST, f"no measurement for {unmeasured:.2f} s, limit {limits.longest_unmeasured:.2f} s"
            )
        elif self.age(now) > limits.command_timeout:
            self.amplifier.trip(
                machine.SILENT, f"no command for {self.age(now):.2f} s, limit {limits.command_timeout:.2f} s"
            )
