"""The recorder's node without an executor: what it makes of when messages came."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from lone_node import lone_node
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from pzt_nodes.recorder_node import RecorderNode
from pzt_ros.bags.reader import open_bag
from pzt_ros.blocks import Block, fill_message
from pzt_ros.reference import block_times

RATE, SIZE = 20e3, 100


class Handle(nullcontext[None]):
    """A reader's queue: messages in the order in which they were said, and when each was received [ns]."""

    def __init__(self, received: list[int]) -> None:
        super().__init__()
        self._queue = [(self._block(tick), at) for tick, at in enumerate(received)]

    @staticmethod
    def _block(tick: int) -> bytes:
        columns = dict.fromkeys(("time_s", "voltage_V", "current_A", "charge_C"), np.zeros(SIZE))
        block = Block.of(columns | {"time_s": block_times(tick, SIZE, RATE)})
        return serialize_message(fill_message(Float64MultiArray(), MultiArrayDimension, block))

    def take_message(self, _kind: object, _raw: bool) -> tuple[bytes, dict[str, int]] | None:
        if not self._queue:
            return None
        data, at = self._queue.pop(0)
        return data, {"received_timestamp": at, "source_timestamp": at}


def test_a_message_sent_again_keeps_its_place(tmp_path: Path) -> None:
    """DDS receives it last, and gives it out where it belongs."""
    with lone_node(RecorderNode, f"bag:={tmp_path / 'bag'}", "nodes:=recorder") as recorder:
        channel, _ = recorder._queues[list(recorder._names).index("/stage/applied")]
        recorder._queues = [(channel, SimpleNamespace(handle=Handle([10**9, 5 * 10**9, 3 * 10**9]), msg_type=None))]
    bag = open_bag(tmp_path / "bag")
    assert np.all(np.diff(bag.blocks("/stage/applied").time) > 0.0)
    assert [at for at, _ in bag.messages("/stage/applied")] == [10**9, 5 * 10**9, 5 * 10**9]
    assert recorder.counts == {}
