"""How times are taken: on one core, as processor time, the best of several."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable, Iterator
from typing import TypeVar

T = TypeVar("T")

_AT_LEAST = 0.5  # [s]


@contextlib.contextmanager
def one_core() -> Iterator[None]:
    """Keep this process, and those it starts, on one core."""
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(allowed)})  # interrupts prefer the first
    try:
        yield
    finally:
        os.sched_setaffinity(0, allowed)


def timed(call: Callable[[], T]) -> tuple[float, T]:
    """Processor time of a call [s], and what it returns.

    On an idle core this is the time on the clock; on a busy one, the time that it would have been.
    """
    began = time.process_time()
    result = call()
    return time.process_time() - began, result


def best(call: Callable[[], object], repeats: int) -> float:
    """The shortest processor time of several calls after one that does not count, over at least half a second [s].

    On a shared machine a neighbour may take half of a core for some milliseconds: calls shorter than that are repeated.
    """
    call()
    times: list[float] = []
    while len(times) < repeats or sum(times) < _AT_LEAST:
        times.append(timed(call)[0])
    return min(times)
