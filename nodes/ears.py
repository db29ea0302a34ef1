"""Listening without being woken: blocks are fetched when the node has time for them."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Iterator
from itertools import chain
from typing import Any

from rclpy.node import Node

from pzt_config.qos import QOS
from pzt_config.topics import TOPICS
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import TYPES, block_of
from pzt_ros.blocks import Block, BlockError


class Ears:
    """Subscriptions that belong to a node no executor spins, because waking up for each message costs the most.

    As many blocks are kept as the topic's QoS says; what is older is gone when it is not fetched in time.
    """

    def __init__(self, owner: GraphNode, names: tuple[str, ...]) -> None:
        self._block_size = owner.block_size
        self._handed: dict[str, deque[bytes]] = {name: deque(maxlen=QOS[TOPICS[name].qos].depth) for name in names}
        self._node = Node(
            f"{owner.role}_ears",
            namespace=owner.get_namespace(),
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._subscriptions = {
            name: self._node.create_subscription(
                TYPES[TOPICS[name].type], name, lambda _: None, owner.qos(TOPICS[name]), raw=True
            )
            for name in names
        }
        if owner.intra_process:
            for name, subscription in self._subscriptions.items():
                owner.intra_process.listen(subscription.topic_name, self._handed[name].append)

    def take(self) -> Iterator[tuple[str, Block]]:
        """What has arrived since the last time, topic by topic; what is no block of the table is passed over."""
        for name, subscription in self._subscriptions.items():
            for data in chain(taken(subscription), emptied(self._handed[name])):
                with contextlib.suppress(BlockError):
                    yield name, block_of(TOPICS[name], data, self._block_size)

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_node()


def emptied(handed: deque[bytes]) -> Iterator[bytes]:
    """What a node of this process has said since."""
    while handed:
        yield handed.popleft()


def taken(subscription: Any) -> Iterator[bytes]:
    """What DDS has kept for a subscription that no executor serves, as bytes."""
    with subscription.handle:
        while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
            yield taken[0]
