"""An amplifier node in a process of its own, and around it a foreign node that plays the whole graph in real time."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from pzt_benchmarks.soak.foreign import ForeignNode
from pzt_benchmarks.soak.processes import free_domain
from pzt_config.topics import TOPICS
from pzt_ros.chains import load_chain
from pzt_ros.hardware.limits import Limits
from pzt_ros.hardware.stage import SimulatedSensor, SimulatedStage
from pzt_ros.physics.signals import Array, Rest
from pzt_ros.reference import block_times
from pzt_ros.ros_environment import ros_environment
from pzt_ros.wire import encode

RATE, SIZE = 20e3, 100
LIMITS = Limits()
CHAIN = "thesis-p2"
LOW, HIGH, SWEEP = 5.0, 125.0, 0.1
"""The stage is driven up and down between these voltages [V], in this time each way [s]."""

Reading = Callable[[Array, Array], tuple[Array, Array] | None]
Command = Callable[[Array, Array], Iterable[bytes]]


def honest_reading(block_time: Array, values: Array) -> tuple[Array, Array] | None:
    """A sensor that works."""
    return block_time, values


def as_bytes(block_time: Array, values: Array) -> bytes:
    """A block of commands for the wire."""
    return encode(TOPICS["drive"].columns, (block_time, values))


def honest_command(block_time: Array, values: Array) -> Iterable[bytes]:
    """A sender that works."""
    return [as_bytes(block_time, values)]


class LoneAmplifier:
    """The node under test. The other nodes are played by `tick`, with faults where the test puts them.

    Every voltage that comes out is checked against window and slew rate, whatever the fault.

    Attributes:
        reading, command: what becomes of the sensor's block and of the block of commands before they are sent.
        voltage: at the stack [V], as last said; `heard` is when that was [s, monotonic].
        zero_since: when 0 V was first said after the last block with voltage [s, monotonic].
    """

    def __init__(self, folder: Path, options: tuple[str, ...] = (), environment: dict[str, str] | None = None) -> None:
        self.log = folder / "amplifier.log"
        self._options = [word for option in options for word in ("-p", option)]
        self._environment = environment or {}
        self.reading: Reading = honest_reading
        self.command: Command = honest_command

    def __enter__(self) -> LoneAmplifier:
        domain = free_domain()
        self.foreign = ForeignNode(domain)
        self._stream = self.log.open("wb")
        self.process = subprocess.Popen(
            [sys.executable, "-m", "pzt_nodes.amplifier_node", "--ros-args", *self._options],
            env={**ros_environment(self.log.parent, domain), **self._environment},
            stderr=self._stream,
            start_new_session=True,
        )
        node, qos = self.foreign.node, QoSProfile(depth=10)
        self.senders = {
            name: node.create_publisher(Float64MultiArray, f"/stage/{name}", qos)
            for name in ("drive", "measurement", "estimate")
        }
        self.status: dict[str, str] = {}
        self.voltage, self.heard, self.zero_since = 0.0, 0.0, 0.0
        self.next_block = 0
        self._applied: list[tuple[Array, Array]] = []
        chain = load_chain(CHAIN)
        self._stage, self._sensor = SimulatedStage(chain, Rest()), SimulatedSensor(chain, Rest())
        node.create_subscription(Float64MultiArray, "/stage/applied", self._on_applied, QoSProfile(depth=1000))
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_status, QoSProfile(depth=100))
        self.foreign.spin_until(lambda: bool(self.status))
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        try:
            if self.process.poll() is None:
                self.process.send_signal(signal.SIGINT)
                self.process.wait(20.0)
        finally:
            self.process.kill()
            self.process.wait()
            self._stream.close()
            self.foreign.__exit__()

    # -- what is heard

    def _on_applied(self, message: Float64MultiArray, info: dict[str, int]) -> None:
        values = np.array(message.data).reshape(SIZE, -1)
        voltage = values[:, 1]
        step = np.abs(np.diff(voltage, prepend=self.voltage if self.next_block else voltage[0]))
        assert np.all(np.isfinite(voltage)), "a voltage that is no number was put out"
        assert voltage.min() >= LIMITS.voltage_min - 1e-9, "below the window"
        assert voltage.max() <= LIMITS.voltage_max + 1e-9, "above the window"
        assert step.max() <= LIMITS.slew_rate / RATE * (1 + 1e-9), "faster than the slew rate"
        self.heard = time.monotonic() - (time.time() - info["received_timestamp"] * 1e-9)  # not when it is our turn
        if voltage[-1] != 0.0 or self.voltage != 0.0:
            self.zero_since = self.heard
        self.voltage = float(voltage[-1])
        self.next_block = round(float(values[0, 0]) * RATE / SIZE) + 1
        self._applied.append((values[:, 0], voltage))

    def _on_status(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.endswith("/amplifier"):
                self.status = {pair.key: pair.value for pair in status.values}

    @property
    def state(self) -> str:
        """Of the amplifier, as it says."""
        return self.status.get("state", "")

    def found(self) -> str:
        """State, voltage and reason in one line."""
        reason = self.status.get("reason", "")
        return f"{self.state} at {self.voltage:.1f} V" + (f": {reason}" if reason else "")

    @property
    def alive(self) -> bool:
        """Whether its process runs."""
        return self.process.poll() is None

    def count(self, key: str) -> int:
        """How often the amplifier says it has refused or limited something."""
        return int(self.status.get(key, 0))

    # -- the graph around it

    def tick(self) -> None:
        """What sensor, observer and controller would say of the blocks just applied; then the next command, in time."""
        if not self._applied:
            self.foreign.spin_once(0.05)
            return
        for block_time, voltage in self._applied:
            self._measure(block_time, voltage)
        self._applied.clear()
        self._wait_for_pace()
        for data in self.command(*self.next_command()):
            self.senders["drive"].publish(data)
        self.foreign.spin_once(0.0)

    def _measure(self, block_time: Array, voltage: Array) -> None:
        truth = self._stage.step(block_time, voltage)
        said = self.reading(block_time, self._sensor.read(block_time, truth.displacement))
        if said is None:
            return
        self.senders["measurement"].publish(encode(TOPICS["measurement"].columns, said))
        nothing = np.zeros(SIZE)
        estimate = (block_time, truth.displacement, nothing, nothing, said[1] - truth.displacement, nothing)
        self.senders["estimate"].publish(encode(TOPICS["estimate"].required, estimate))

    def _wait_for_pace(self) -> None:
        due = self._began + (self.next_block - self._first) * SIZE / RATE
        if (left := due - time.monotonic()) > 0.0:
            time.sleep(left)

    def next_command(self) -> tuple[Array, Array]:
        """Time and voltage of the block that is in turn: up and down, from wherever the stack is."""
        block_time = block_times(self.next_block, SIZE, RATE)
        phase = (block_time - self._first * SIZE / RATE) / SWEEP
        wanted = LOW + (HIGH - LOW) * np.abs((phase + 1.0) % 2.0 - 1.0)
        return block_time, wanted

    def run(self, until: Callable[[], bool], patience: float = 10.0) -> bool:
        """Tick until something has happened; whether it has in time."""
        deadline = time.monotonic() + patience
        while not until():
            if time.monotonic() > deadline or not self.alive:
                return False
            self.tick()
        return True

    def run_for(self, seconds: float) -> None:
        """Tick for a while."""
        end = time.monotonic() + seconds
        self.run(lambda: time.monotonic() > end, seconds + 5.0)

    # -- what is asked of it

    def call(self, name: str, kind: Any, **request: Any) -> tuple[bool, str]:
        """Call a service of the axis."""
        client = self.foreign.node.create_client(kind, f"/stage/{name}")
        self.foreign.spin_until(client.service_is_ready, 20.0)
        future = client.call_async(kind.Request(**request))
        self.foreign.spin_until(future.done, 20.0)
        self.foreign.node.destroy_client(client)
        return future.result().success, future.result().message

    def start(self) -> None:
        """Enabled, driven up and down, with everything in order."""
        self.reading, self.command = honest_reading, honest_command
        self._applied.clear()
        if self.state == "fault":
            self.call("reset", Trigger)
        granted, why = self.call("enable", SetBool, data=True)
        assert granted, why
        self.foreign.spin_until(lambda: bool(self._applied), 10.0)
        self._first, self._began = self.next_block, time.monotonic()
        assert self.run(lambda: self.state == "enabled" and self.voltage > 0.9 * HIGH), self.status

    def stop(self) -> float:
        """To 0 V, as asked; how long that took [s]."""
        asked = time.monotonic()
        self.call("enable", SetBool, data=False)
        self.foreign.spin_until(lambda: self.state in ("disabled", "fault") and self.voltage == 0.0, 10.0)
        return max(self.zero_since - asked, 0.0)
