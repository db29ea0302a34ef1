"""A node written as a user would write it: plain rclpy, nothing of ours but the topic table to compare with."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from importlib import resources
from types import TracebackType
from typing import Any

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile

# Announces itself every 0.5 s instead of every 3 s, so that a run that starts soon is heard from its first block.
os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(resources.files("pzt_config") / "fastdds.xml")


class ForeignNode:
    """Listens to topics in a ROS domain and keeps what it hears."""

    def __init__(self, domain: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain)
        self.node = Node("foreign", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.heard: dict[str, list[Any]] = {}

    def __enter__(self) -> ForeignNode:
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def listen(self, topic: str, message_type: type) -> None:
        """Keep every message of a topic."""
        self.heard[topic] = []
        self.node.create_subscription(message_type, topic, self.heard[topic].append, QoSProfile(depth=1000))

    def spin_once(self, patience: float) -> None:
        """Handle what comes next, if it comes within `patience` [s]."""
        self._executor.spin_once(timeout_sec=patience)

    def spin_until(self, done: Callable[[], bool], patience: float = 60.0) -> None:
        """Handle messages until a condition holds; fail if it does not in time."""
        clock = self.node.get_clock()
        deadline = clock.now().nanoseconds + int(patience * 1e9)
        while not done():
            assert clock.now().nanoseconds < deadline, f"waited {patience:.0f} s in vain"
            self._executor.spin_once(timeout_sec=0.05)

    def hear_out(self, quiet: float = 0.5) -> None:
        """Handle what has come and was not in turn yet, until nothing was kept for so long [s]."""
        before = -1
        while (heard := sum(len(messages) for messages in self.heard.values())) > before:
            before, end = heard, time.monotonic() + quiet
            while time.monotonic() < end:
                self._executor.spin_once(timeout_sec=0.05)
