"""Wakes the executor when the system clock is set back.

The wheels wait for a timer by the system's clock, whatever clock the timer has: set back in the middle of such a wait,
a watchdog sleeps on for as long as the step (the C++ runtime they are built for knows no other wait).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

PERIOD = 0.02
"""The two clocks are compared this often [s]."""
STEP = 0.005
"""By so much they may part in that time [s]; a clock that is slewed drifts by a thousandth of it."""


class ClockGuard:
    """A thread that compares the system's clock with the one nobody sets, while `with` lasts."""

    def __init__(self, executor: Any, nodes: Sequence[Node]) -> None:
        self._executor = executor
        self._nodes = nodes
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="clock-guard", daemon=True)

    def __enter__(self) -> ClockGuard:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        apart = _apart()
        while not self._over.is_set():
            time.sleep(PERIOD)  # not the event's own wait, which may follow the clock that is watched
            now = _apart()
            if abs(now - apart) > STEP:
                self._executor.create_task(self._arm_anew)
            apart = now

    def _arm_anew(self) -> None:
        """A new timer makes the executor look anew at when the next one of that clock is due; then it goes."""
        for node in self._nodes:
            self._arm_clock_of(node)

    def _arm_clock_of(self, node: Node) -> None:
        timer = node.create_timer(PERIOD, lambda: node.destroy_timer(timer))


def _apart() -> float:
    """By how much the system's clock is ahead of the one nobody sets [s]."""
    while True:
        before = time.monotonic()
        system = time.time()
        after = time.monotonic()
        if after - before < STEP / 2:  # otherwise somebody else had the processor in between
            return system - 0.5 * (before + after)
