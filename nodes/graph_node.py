"""What all nodes share: topics from the table, readiness, health, and how they are spun and stopped."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from pzt_config.qos import QOS
from pzt_config.topics import FLOAT, JOINT_STATE, NODES, TOPICS, Topic, published_by, readers_of, subscribed_by
from pzt_nodes.intra_process import IntraProcess, IntraProcessClient, IntraProcessPublisher
from pzt_nodes.messages import TYPES, block_of, diagnostics, status_of
from pzt_nodes.parameters import declare_all, declare_text
from pzt_nodes.priority import priority
from pzt_nodes.turns import Turns
from pzt_ros.blocks import Block, BlockError
from pzt_ros.chains import load_chain, load_model
from pzt_ros.physics.chain import Chain
from pzt_ros.physics.signals import Rest
from pzt_ros.processors import processors
from pzt_ros.scenario import Timing
from pzt_ros.wire import encode

SETTLE_TIME = 0.5
"""Readers are given this long [s] to have all: DDS asks them for what they lack only every 3 s, so mostly it is all."""
COMPLAINTS = 1.0
"""What goes on is complained of so seldom [s]."""
PLOT_RATE = 50.0
"""The decimated topics for plotters are published at most this often [Hz]."""
PLOTTED = tuple(topic.name for topic in TOPICS.values() if topic.type in (FLOAT, JOINT_STATE))
"""In turn, not all in the same tick, which would be late for it."""


class GraphNode(Node):
    """A node whose topics come from the table.

    Children call `publish` and `listen`, say how they are with `health`, and keep their work in one library object.
    """

    turns: ClassVar[Turns] = Turns()
    """Of the executor of this process."""
    intra_process: ClassVar[IntraProcess | None] = None
    """Between the nodes of a process that has several."""

    def __init__(self, name: str, *, needs_timing: bool = True) -> None:
        super().__init__(name, namespace="/stage")  # remap __ns for another axis
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.role = name
        self.axes = (self.get_namespace(),)  # whose part it takes
        self.counts: Counter[str] = Counter()
        self.ticks = 0
        self.exit_code: int | None = None
        self._publishers_by_topic = {topic.name: self._publisher(topic) for topic in published_by(name)}
        self._plotted: dict[str, float] = {}
        self._complained: dict[str, float] = {}
        if needs_timing:
            self.timing = declare_all(self, "", Timing(), read_only=True)
            self.sample_rate = self.timing.sample_rate
            self.block_size = int(self.timing.block_size)
            self.rest = Rest(seed=int(self.timing.seed))
        self.peers = tuple(
            declare_text(self, "nodes", ",".join(NODES), "nodes of this graph, comma separated").split(",")
        )
        self._report_to_supervisor = os.environ.get("PZT_STATUS") == "1"  # set by bringup: a line of JSON on stdout
        self._last_report = (time.monotonic(), 0)
        self.get_logger().info("starting")  # the first line of a process costs up to 70 ms; not in the middle of a run
        self._was_ready = False
        self.create_timer(1.0, self._report)
        self._readiness_timer = self.create_timer(0.05, self._watch_readiness)

    def create_timer(self, period: float, callback: Callable[[], None]) -> Any:
        """A timer on a clock that nobody sets; all timers of the node share it, so that one can wake the others' wait.

        The default one follows the system's clock, or `/clock`: when that is set back, a watchdog on it falls asleep
        for as long as the step.
        """
        return super().create_timer(period, callback, clock=self._steady)

    # -- topics and services

    def qos(self, topic: Topic) -> QoSProfile:
        """The QoS of a topic as the table has it."""
        return self._qos(topic)

    def _qos(self, topic: Topic, depth: int | None = None) -> QoSProfile:
        profile = QOS[topic.qos]
        return QoSProfile(
            depth=depth or profile.depth,
            reliability=ReliabilityPolicy[profile.reliability.upper()],
            durability=DurabilityPolicy[profile.durability.upper()],
        )

    def _publisher(self, topic: Topic) -> Any:
        publisher = self.create_publisher(TYPES[topic.type], topic.name, self._qos(topic, QOS[topic.qos].sender_depth))
        return IntraProcessPublisher(publisher, self.intra_process) if self.intra_process else publisher

    def hear(self, topic: Topic, callback: Callable[[Any], None], *, raw: bool, depth: int | None = None) -> None:
        """Call `callback` with every message on a topic, as bytes where it is `raw`.

        Args:
            depth: how many are kept for a node that is late; the topic's own by default.
        """
        heard = self.create_subscription(TYPES[topic.type], topic.name, callback, self._qos(topic, depth), raw=raw)
        if self.intra_process:
            self.intra_process.listen(heard.topic_name, callback)

    def create_service(self, kind: Any, name: str, callback: Callable[[Any, Any], Any], **options: Any) -> Any:
        """As rclpy has it; offered to the nodes of this process, too."""
        service = super().create_service(kind, name, callback, **options)
        if self.intra_process:
            self.intra_process.offer(self.resolve_service_name(name), kind, callback)
        return service

    def create_client(self, kind: Any, name: str, **options: Any) -> Any:
        """As rclpy has it; a node of this process is asked without DDS."""
        client = super().create_client(kind, name, **options)
        if not self.intra_process:
            return client
        return IntraProcessClient(client, self.resolve_service_name(name), self.intra_process)

    def listen(self, name: str, callback: Callable[[Block], None], depth: int | None = None) -> None:
        """As `hear`, with blocks; what is no block as the table has it is counted and dropped."""
        topic = TOPICS[name]

        def receive(data: bytes) -> None:
            try:
                block = block_of(topic, data, self.block_size)
            except BlockError as error:
                self.refuse(name, str(error))
                return
            callback(block)

        self.hear(topic, receive, raw=True, depth=depth)

    def listen_to_health(self, callback: Callable[[str, str, str, dict[str, str]], None]) -> None:
        """Call `callback` with what each node of this axis says of itself: role, level, one line, values."""
        here = self.get_namespace().rstrip("/")

        def receive(message: Any) -> None:
            for node, level, text, values in status_of(message):
                namespace, _, role = node.rpartition("/")
                if namespace == here:
                    callback(role, level, text, values)

        self.hear(TOPICS["/diagnostics"], receive, raw=False)

    def name_on(self, axis: str, topic: Topic) -> str:
        """A topic's full name on an axis."""
        return topic.name if topic.name.startswith("/") else f"{axis.rstrip('/')}/{topic.name}"

    def refuse(self, name: str, why: str) -> None:
        """Count a message that cannot be used, and say why (at most once a second)."""
        self.counts[f"refused on {name}"] += 1
        if self.may_complain(name):
            self.get_logger().warning(f"message on '{name}' refused: {why}")

    def may_complain(self, of: str) -> bool:
        """Whether nothing was said of it for a second; rclpy's own throttle looks for its caller each time, 0.4 ms."""
        now = time.monotonic()
        if now - self._complained.get(of, -COMPLAINTS) < COMPLAINTS:
            return False
        self._complained[of] = now
        return True

    def publish(self, name: str, *arrays: NDArray[np.float64]) -> None:
        """Publish a block: one array per column of the table, without its optional ones where there are none."""
        self._publishers_by_topic[name].publish(encode(TOPICS[name].layout_of[len(arrays)], arrays))

    def plot(self, name: str, time_s: float, make: Callable[[], Any]) -> None:
        """Publish on a decimated topic, unless its last message is younger than 1/50 s of the run's own time."""
        turn = PLOTTED.index(name) / len(PLOTTED) - 1.0
        if time_s - self._plotted.get(name, turn / PLOT_RATE) >= 1.0 / PLOT_RATE - 1e-9:
            self._plotted[name] = time_s
            self.turns.take(lambda: self._publishers_by_topic[name].publish(make()))  # no tick waits for it

    def tick_of(self, block: Block) -> int:
        """The number of a block, counted from the start of the run."""
        return round(block.first_time * self.sample_rate / self.block_size)

    # -- the chain

    def load_plant(self) -> Chain:
        """The chain of the simulated stage, named by the read-only parameter `chain`."""
        return load_chain(declare_text(self, "chain", "thesis-p2", "chain that is simulated: shipped name or path"))

    def load_model(self) -> Chain:
        """The chain this node believes in, named by the read-only parameter `model`."""
        return load_model(declare_text(self, "model", "thesis-p2", "chain believed in: shipped name or path"))

    # -- readiness and health

    def missing(self) -> list[str]:
        """What this node still waits for before a run can start: unmatched topics."""
        waits = [
            f"no publisher on {name}"
            for axis in self.axes
            for topic in subscribed_by(self.role, self.peers)
            if topic.publisher in self.peers and self.count_publishers(name := self.name_on(axis, topic)) == 0
        ]
        for topic in published_by(self.role):
            if topic.publisher == "*":
                continue
            wanted = readers_of(topic, self.peers)
            found = self._publishers_by_topic[topic.name].get_subscription_count()
            if found < wanted:
                waits.append(f"{found} of {wanted} readers on {topic.name}")
        return waits

    def health(self) -> tuple[str, str, dict[str, object]]:
        """Level (ok, warn, error), one line, and values; nodes with more to say override it."""
        if not self._was_ready:
            return "warn", "waiting: " + "; ".join(self.missing()), {}
        return ("warn" if self.counts else "ok"), ("running" if self.ticks else "ready"), {}

    def _watch_readiness(self) -> None:
        if not self.missing():
            self._was_ready = True
            self._readiness_timer.cancel()
            self._report()

    def _report(self) -> None:
        level, text, values = self.health()
        now, ticks = time.monotonic(), self.ticks
        before, counted = self._last_report
        rate = (ticks - counted) / max(now - before, 1e-3)
        if now - before > 0.5:
            self._last_report = (now, ticks)
        values = {"ticks": ticks, "ticks_per_second": round(rate, 1), **values, **self.counts}
        values["ready"] = self._was_ready
        values["nodes"] = ",".join(self.peers)
        values["priority"], values["processors"] = priority(), processors()
        values["cpu_s"] = round(time.process_time(), 3)
        now_said = self.get_clock().now().to_msg()
        for axis in self.axes:
            said = diagnostics(now_said, f"{axis.rstrip('/')}/{self.role}", level, text, values)
            self._publishers_by_topic["/diagnostics"].publish(said)
        if self._report_to_supervisor:
            status = {"node": self.role, "level": level, "state": text, **values}
            # A supervisor that was killed must not take the ramp to 0 V with it.
            with contextlib.suppress(OSError):
                sys.stdout.write("PZT_STATUS " + json.dumps(status) + "\n")
                sys.stdout.flush()

    # -- the end

    def finish(self, code: int = 0) -> None:
        """This node has nothing more to do; the process ends, with the highest code of its nodes."""
        self.exit_code = code if self.exit_code is None else max(self.exit_code, code)
        self._report()

    def stop(self) -> None:
        """Asked to stop (Ctrl-C, or the run is over): a node that has to tidy up first overrides this."""
        self.finish()

    def settle(self) -> None:
        """Stay a moment, until what was said has arrived with every reader: a bag must not lack the end of the run."""
        deadline = time.monotonic() + SETTLE_TIME
        for publisher in self._publishers_by_topic.values():
            left = max(deadline - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(nanoseconds=round(1e9 * left)))

    def close(self) -> None:
        """Called once before the node is destroyed."""
