"""The panel's node: what the page shows goes out on stdout, what is clicked comes in on stdin, in lines of JSON.

It stands beside the graph and belongs to no run: it may join, leave or die at any time. What it hears is read from a
timer, many messages at a time (as `ears.py` does); what it asks goes through the services, the parameter and the topic
that everybody else uses, and past the same guards.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
from typing import Any

from rcl_interfaces.msg import Log
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from pzt_config.topics import TOPICS
from pzt_nodes.ears import taken
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import TYPES, block_of
from pzt_nodes.panel_requests import Requests
from pzt_nodes.parameters import declare_text
from pzt_nodes.spin import main as run_node
from pzt_ros.blocks import BlockError
from pzt_ros.panel.frames import SOURCES, Frames
from pzt_ros.panel.priority import stand_back
from pzt_ros.panel.replay import health_of

FRAME = 0.05
"""Between two frames [s]: 20 a second."""

DEPTH = 50
"""Blocks that DDS keeps for us: 250 ms of the graph's stream."""


class PanelNode(GraphNode):
    """Hears the axis of its namespace, thins it out, and hands requests on."""

    def __init__(self) -> None:
        super().__init__("panel", needs_timing=False)
        read_only = declare_text(self, "read_only", "false", "whether requests are refused: true or false") == "true"
        self._frames = Frames()
        self._ears = Node(
            "panel_ears", namespace=self.get_namespace(), start_parameter_services=False, enable_rosout=False
        )
        # A block that is lost is not missed on a screen; to have it sent again costs those who send it.
        self._blocks = {name: self._subscribe(name, ReliabilityPolicy.BEST_EFFORT) for name in SOURCES}
        self._diagnostics = self._subscribe("/diagnostics", ReliabilityPolicy.RELIABLE)
        self._log = self._ears.create_subscription(Log, "/rosout", lambda _: None, QoSProfile(depth=DEPTH), raw=True)
        self._said = threading.Lock()
        self._clicks: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._requests = Requests(self, self.say, read_only=read_only)
        self.create_timer(FRAME, self._frame)
        threading.Thread(target=self._read_clicks, name="clicks", daemon=True).start()

    def _subscribe(self, name: str, reliability: ReliabilityPolicy) -> Any:
        topic = TOPICS[name]
        qos = self._qos(topic, DEPTH)
        qos.reliability = reliability
        return self._ears.create_subscription(TYPES[topic.type], topic.name, lambda _: None, qos, raw=True)

    # -- out

    def say(self, message: dict[str, Any]) -> None:
        """A line for the page; a page that is gone is noticed on stdin."""
        line = json.dumps(message, separators=(",", ":"), default=str) + "\n"
        with self._said:
            try:
                sys.stdout.write(line)
                sys.stdout.flush()
            except OSError:
                self.finish()

    def _frame(self) -> None:
        """Twenty times a second: clicks first, then what was heard."""
        self._take_clicks()
        for name, subscription in self._blocks.items():
            for data in taken(subscription):
                self._add(name, data)
        if rows := self._frames.take():
            self.ticks += 1
            self._requests.saw(rows[-1])
            self.say({"rows": rows})
        health = [said for data in taken(self._diagnostics) for said in self._health(data)]
        if health:
            self.say({"health": health})
            self._requests.hear_health(health)
        for data in taken(self._log):
            self._requests.hear_log(deserialize_message(data, Log))
        self._requests.look_after()

    def _add(self, name: str, data: bytes) -> None:
        try:
            self._frames.add(name, block_of(TOPICS[name], data))
        except BlockError:
            self.counts[f"refused on {name}"] += 1

    def _health(self, data: bytes) -> list[dict[str, Any]]:
        return health_of(
            deserialize_message(data, TYPES[TOPICS["/diagnostics"].type]), self.get_namespace().rstrip("/")
        )

    # -- in

    def _read_clicks(self) -> None:
        for line in sys.stdin:
            self._clicks.put(line)
        self._clicks.put(None)  # the page is gone

    def _take_clicks(self) -> None:
        while True:
            try:
                line = self._clicks.get_nowait()
            except queue.Empty:
                return
            if line is None:
                self.finish()
            else:
                self._requests.take(line)

    def close(self) -> None:
        """Stop listening; the stage stays as it is."""
        self._requests.close()
        self._ears.destroy_node()


def main() -> None:
    """Run the panel's node."""
    stand_back()
    run_node(PanelNode)


if __name__ == "__main__":
    main()
