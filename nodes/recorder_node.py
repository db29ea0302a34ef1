"""The recorder: every logged topic goes to the bag as the bytes that came over the wire."""

from __future__ import annotations

import time

from std_srvs.srv import SetBool

from pzt_config.qos import QOS
from pzt_config.topics import Topic, subscribed_by
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import TYPES
from pzt_nodes.parameters import declare_text
from pzt_nodes.spin import main as run_node
from pzt_ros.bags.writer import BagWriter

FLUSH_PERIOD = 0.1
"""A crash loses no more than this [s]."""


class RecorderNode(GraphNode):
    """Records from the start; `record` pauses and goes on."""

    def __init__(self) -> None:
        super().__init__("recorder", needs_timing=False)
        folder = declare_text(self, "bag", "bag", "folder of the bag; must not exist yet")
        self._writer: BagWriter | None = BagWriter(folder)
        self._recording = True
        for topic in subscribed_by("recorder"):
            self._record(topic)
        self.create_service(SetBool, "record", self._on_record)
        self.create_timer(FLUSH_PERIOD, self._flush)

    def _record(self, topic: Topic) -> None:
        assert self._writer is not None
        qos = self._qos(topic, QOS[topic.qos].recorder_depth)
        channel = self._writer.add_topic(
            self.resolve_topic_name(topic.name), topic.type, QOS[topic.qos]
        )

        def write(data: bytes) -> None:
            if self._recording and self._writer is not None:
                self.ticks += 1
                self._writer.write(channel, data, time.time_ns())

        self.create_subscription(TYPES[topic.type], topic.name, write, qos, raw=True)

    def _flush(self) -> None:
        if self._writer is not None:
            try:
                self._writer.flush()
            except OSError as error:
                self.counts[f"bag cannot be written: {error.strerror}"] += 1
                self.get_logger().error(f"bag cannot be written: {error.strerror}", throttle_duration_sec=1.0)

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._recording = bool(request.data)
        response.success, response.message = True, "recording" if self._recording else "paused"
        return response

    def close(self) -> None:
        """Finish the bag."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def main() -> None:
    """Run the recorder node."""
    run_node(RecorderNode)


if __name__ == "__main__":
    main()
