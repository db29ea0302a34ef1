"""The recorder: every logged topic goes to the bag as the bytes that came over the wire."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from operator import itemgetter
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool

from pzt_config.qos import QOS
from pzt_config.topics import TOPICS, Topic, subscribed_by
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import TYPES, block_of
from pzt_nodes.parameters import declare_text
from pzt_nodes.spin import main as run_node
from pzt_ros.bags.continuity import MISSING, Continuity
from pzt_ros.bags.writer import BagWriter
from pzt_ros.blocks import BlockError
from pzt_ros.errors import RunFailedError

DRAIN_PERIOD = 0.02
"""The queues are emptied this often [s]: rarely costs fewer wake-ups, often finds the messages still in the cache."""
FLUSH_PERIOD = 0.5
"""What was read is handed to the system this often [s]; a crash loses no more than this. Each time makes a chunk, whose
index stays in memory until the file ends."""

WATCHED = "applied"
"""The topic that has a block for every tick of a run, whatever the instruments are."""


class RecorderNode(GraphNode):
    """Records from the start; `record` pauses and goes on.

    Its subscriptions belong to a node that no executor spins: they are read from a timer, many messages at a time,
    because waking up for each of them costs as much as all the rest of the recorder. DDS keeps them meanwhile
    (`recorder_depth`), and says when each was sent and received.
    """

    def __init__(self) -> None:
        super().__init__("recorder", needs_timing=False)
        folder = declare_text(self, "bag", "bag", "folder of the bag; must not exist yet")
        self._writer = BagWriter(folder)
        self._recording = True
        self._failed = False
        self._ears = Node("recorder_ears", namespace=self.get_namespace())
        axes = declare_text(self, "axes", "", "namespaces of the axes to record, comma separated; its own by default")
        self.axes = tuple(axes.split(",")) if axes else self.axes
        self._names = {self.name_on(axis, topic): topic for axis in self.axes for topic in subscribed_by("recorder")}
        self._queues = [self._listen(name, topic) for name, topic in self._names.items()]
        listened = zip(self._queues, self._names.values(), strict=True)
        self._watched = {channel: Continuity() for (channel, _), topic in listened if topic.name == WATCHED}
        self.create_service(SetBool, "record", self._on_record)
        self.create_timer(DRAIN_PERIOD, self._drain)
        self.create_timer(FLUSH_PERIOD, lambda: self._guarded(self._writer.flush))

    def _listen(self, name: str, topic: Topic) -> tuple[int, Any]:
        channel = self._writer.add_topic(name, topic.type, QOS[topic.qos])
        qos = self._qos(topic, QOS[topic.qos].recorder_depth)
        return channel, self._ears.create_subscription(TYPES[topic.type], name, lambda _: None, qos, raw=True)

    def missing(self) -> list[str]:
        """Publishers that the recorder's own readers have not found: what these say now would not be in the bag.

        That they are known to exist is not enough: they find each other one by one, and from both sides.
        """
        return super().missing() + [
            f"{name} not matched"
            for (name, topic), (_, subscription) in zip(self._names.items(), self._queues, strict=True)
            if topic.publisher in self.peers and subscription.get_publisher_count() == 0
        ]

    def _drain(self) -> None:
        """Write all that has arrived, in the order of arrival; on each topic, in the order in which it was said.

        A message that DDS had to send again is received after those that follow it, which wait for it.
        """
        arrived = []
        for channel, subscription in self._queues:
            latest = 0
            with subscription.handle:
                while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                    data, about = taken
                    latest = max(latest, about["received_timestamp"])
                    arrived.append((channel, data, latest, about["source_timestamp"]))
        if self._recording:
            self._guarded(self._writer.write_all, sorted(arrived, key=itemgetter(2)))
            self.ticks += len(arrived)
            self._count_missing(arrived)

    def _count_missing(self, arrived: list[tuple[int, bytes, int, int]]) -> None:
        """A disk that stands still for longer than the queues last leaves a gap: it is said, not silent."""
        missing = 0
        for channel, data, _, _ in arrived:
            if channel in self._watched:
                with contextlib.suppress(BlockError):  # it is in the bag as it is
                    missing += self._watched[channel].take(block_of(TOPICS[WATCHED], data))
        if missing:
            self.counts[MISSING] += missing
            if self.may_complain("gaps"):
                self.get_logger().error(
                    f"{missing} blocks came faster than the recorder could write and are missing in the bag;"
                    " record to a faster disk, or run in real time"
                )

    def _guarded(self, call: Callable[..., None], *arguments: Any) -> None:
        """Write, unless it has failed before; the first failure is said and counted."""
        if self._failed:
            return
        try:
            call(*arguments)
        except RunFailedError as error:
            self._failed = True
            self.counts[str(error)] += 1
            self.get_logger().error(str(error))

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._drain()
        self._recording = bool(request.data)
        for continuity in self._watched.values():
            continuity.pause()
        response.success, response.message = not self._failed, "recording" if self._recording else "paused"
        return response

    def health(self) -> tuple[str, str, dict[str, object]]:
        """Whether the bag can be written."""
        level, text, values = super().health()
        return ("error", "not recording", values) if self._failed else (level, text, values)

    def close(self) -> None:
        """Take in the last messages and finish the bag."""
        self._drain()
        self._writer.close()
        self._ears.destroy_node()


def main() -> None:
    """Run the recorder node."""
    run_node(RecorderNode)


if __name__ == "__main__":
    main()
