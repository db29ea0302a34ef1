"""How nodes are spun and stopped: the events executor with finite deadlines, and a way out that leaves nothing behind.

EventsExecutor.spin() without a deadline hangs in the Jazzy wheels, and a node that is not destroyed haunts the
discovery of the next one for seconds; docs/decisions/0003 has the measurements.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future

from pzt_nodes.clock_guard import ClockGuard
from pzt_ros.errors import BenchError

if TYPE_CHECKING:
    from pzt_nodes.graph_node import GraphNode

SPIN_DEADLINE = 0.1
"""Signals are looked at this often [s]."""
STOP_DEADLINE = 5.0
"""A node that was asked to stop gets this long [s]; the amplifier needs it for the ramp to 0 V."""


def main(make: Callable[[], GraphNode]) -> None:
    """The body of every node's `main`: run it as a process of its own."""
    sys.exit(run([make]))


def run(makes: Sequence[Callable[[], GraphNode]]) -> int:
    """Spin nodes in this process until one has finished or a signal comes; returns the exit code."""
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    asked: list[int] = []
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, lambda number, _frame: asked.append(number))
    nodes: list[GraphNode] = []
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        for make in makes:
            nodes.append(make())  # noqa: PERF401 - if the next one fails, this one is still closed
        return _spin(nodes, asked)
    except (BenchError, InvalidParameterValueException, InvalidParameterTypeException) as error:
        print(f"error: {_one_line(error)}", file=sys.stderr)
        return 2
    finally:
        for node in nodes:
            node.settle()
        for node in nodes:
            node.close()
            node.destroy_node()
        rclpy.try_shutdown()


def _spin(nodes: list[GraphNode], asked: list[int]) -> int:
    executor: Any = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    # What exists now stays; without this every full collection walks the imported libraries, and a tick waits for it.
    gc.collect()
    gc.freeze()
    with ClockGuard(executor, nodes):
        return _spin_to_the_end(executor, nodes, asked)


def _spin_to_the_end(executor: Any, nodes: list[GraphNode], asked: list[int]) -> int:
    never: Future = Future()
    stopping: float | None = None
    while True:
        executor.spin_until_future_complete(never, timeout_sec=SPIN_DEADLINE)
        if stopping is None and (asked or _orphaned() or any(node.exit_code is not None for node in nodes)):
            stopping = time.monotonic()
            for node in nodes:
                node.stop()
        if stopping is not None:
            late = time.monotonic() - stopping > STOP_DEADLINE
            if late or all(node.exit_code is not None for node in nodes):
                return max(node.exit_code or 0 for node in nodes)


def _orphaned() -> bool:
    """Whether the supervisor that started this process is gone: then nobody would ever stop it."""
    parent = os.environ.get("PZT_PARENT")
    return parent is not None and os.getppid() != int(parent)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
