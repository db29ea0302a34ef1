"""Where another axis is, for a plant that feels it."""

from __future__ import annotations

import contextlib

import numpy as np

from pzt_config.topics import TOPICS
from pzt_nodes.graph_node import GraphNode
from pzt_nodes.messages import TYPES, block_of
from pzt_ros.blocks import BlockError
from pzt_ros.physics.signals import Array


class Neighbour:
    """Hears the `truth` of another axis. Axes have no common time, so it is where it said last that it was."""

    def __init__(self, owner: GraphNode, namespace: str) -> None:
        self._topic = TOPICS["truth"]
        self._there = self._felt = 0.0
        owner.create_subscription(
            TYPES[self._topic.type], owner.name_on(namespace, self._topic), self._hear, owner.qos(self._topic), raw=True
        )

    def _hear(self, data: bytes) -> None:
        with contextlib.suppress(BlockError):  # its own observers complain of what is no block
            self._there = float(block_of(self._topic, data)["displacement_m"][-1])

    def along(self, count: int) -> Array:
        """Its displacement over the next block, from where it was felt last [m, shape (count,)]."""
        way = np.linspace(self._felt, self._there, count + 1)[1:]
        self._felt = self._there
        return way
