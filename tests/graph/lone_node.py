"""A node without an executor, in a ROS domain of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import rclpy
from lone_amplifier import own_domain

from pzt_nodes.graph_node import GraphNode

NodeType = TypeVar("NodeType", bound=GraphNode)


@contextmanager
def lone_node(make: Callable[[], NodeType], *options: str) -> Iterator[NodeType]:
    """The node with parameters, each `name:=value`; closed and destroyed in the end."""
    with own_domain() as domain:
        words = [word for option in options for word in ("-p", option)]
        rclpy.init(args=["--ros-args", *words], domain_id=domain)
        try:
            node = make()
            try:
                yield node
            finally:
                node.close()
                node.destroy_node()
        finally:
            rclpy.try_shutdown()
