"""How nodes are spun and stopped: the events executor with finite deadlines, and a way out that leaves nothing behind.

EventsExecutor.spin() without a deadline hangs in the Jazzy wheels, and a node that is not destroyed haunts the
discovery of the next one for seconds; docs/decisions/0003 has the measurements.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.utilities import get_default_context

from pzt_nodes.clock_guard import ClockGuard
from pzt_nodes.priority import take_priority
from pzt_ros.errors import BenchError
from pzt_ros.processors import keep_to_others, take_own
from pzt_ros.ros_environment import orphaned

if TYPE_CHECKING:
    from pzt_nodes.graph_node import GraphNode
    from pzt_nodes.turns import Turns

SPIN_DEADLINE = 0.1
"""Signals are looked at this often [s]."""
STOP_DEADLINE = 5.0
"""A node that was asked to stop gets this long [s]; the amplifier needs it for the ramp to 0 V."""


LEAVE_DEADLINE = 10
"""The middleware gets this long to let go of all nodes [s].

FastDDS was seen to wait for a listener of its own for ever, at full speed, after its supervisor had been killed.
"""


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
    take_priority()
    keep_to_others()  # before DDS starts its threads
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        for make in makes:
            nodes.append(make())  # noqa: PERF401 - if the next one fails, this one is still closed
        take_own()
        return _spin(nodes, asked)
    except (BenchError, InvalidParameterValueException, InvalidParameterTypeException) as error:
        print(f"error: {_one_line(error)}", file=sys.stderr)
        return 2
    finally:
        for node in nodes:
            node.settle()
        for node in nodes:
            node.close()
        leave(nodes)


def leave(nodes: Sequence[GraphNode]) -> None:
    """Destroy nodes and context; what hangs there ends the process by a signal: nothing in Python runs meanwhile."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(LEAVE_DEADLINE)
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()
    get_default_context().destroy()
    signal.alarm(0)


def _spin(nodes: list[GraphNode], asked: list[int]) -> int:
    executor: Any = EventsExecutor()
    for node in nodes:
        executor.add_node(node)
    # What exists now stays; without this every full collection walks the imported libraries, and a tick waits for it.
    gc.collect()
    gc.freeze()
    turns = nodes[0].turns
    with turns.of(executor), ClockGuard(executor, nodes), Bell() as bell:
        return _spin_to_the_end(executor, bell, turns, nodes, asked)


class Bell:
    """Ends a spin that is never idle: the executor looks at its deadline only when it has nothing else to do.

    In a composed graph as fast as possible, each message brings the next one before it is done with.
    """

    def __init__(self) -> None:
        self._turn: Future = Future()
        self._over = False
        self._thread = threading.Thread(target=self._ring, name="bell", daemon=True)

    def __enter__(self) -> Bell:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over = True
        self._thread.join()

    def next_turn(self) -> Future:
        """Done when the bell rings next."""
        self._turn = Future()
        return self._turn

    def _ring(self) -> None:
        while not self._over:
            time.sleep(SPIN_DEADLINE)
            self._turn.set_result(None)


def _spin_to_the_end(executor: Any, bell: Bell, turns: Turns, nodes: list[GraphNode], asked: list[int]) -> int:
    stopping: float | None = None
    while True:
        executor.spin_until_future_complete(bell.next_turn(), timeout_sec=SPIN_DEADLINE)
        if turns.failure is not None:
            raise turns.failure
        if stopping is None and (asked or orphaned() or any(node.exit_code is not None for node in nodes)):
            stopping = time.monotonic()
            for node in nodes:
                node.stop()
        if stopping is not None:
            late = time.monotonic() - stopping > STOP_DEADLINE
            if late or all(node.exit_code is not None for node in nodes):
                return max(node.exit_code or 0 for node in nodes)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
