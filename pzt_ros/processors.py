"""A processor of its own for a composed loop, as ros2_control's controller manager is given one (`cpu_affinity`).

A tick says seven things to DDS, and each wakes a thread that reads it. Where the system puts that on the processor of
the loop it takes its turn there first, 3 to 4 ms, beside another that is idle.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable

OTHERS, OWN = "PZT_PROCESSORS", "PZT_OWN_PROCESSOR"
"""Set by bringup: where a process of the graph runs, and where the thread that spins the loop does."""


def keep_to_others() -> None:
    """Leave the loop's processor free, where there is one; threads that are started later do so, too."""
    _keep_to(os.environ.get(OTHERS, ""))


def take_own() -> None:
    """Move this thread to the loop's processor, where there is one; all others of the process stay."""
    _keep_to(os.environ.get(OWN, ""))


def shared_out(allowed: Iterable[int], in_loop: bool) -> dict[str, str]:
    """The environment of a process beside or in a composed loop; empty where there is one processor only."""
    *others, own = sorted(allowed)
    if not others:
        return {}
    return {OTHERS: ",".join(map(str, others)), **({OWN: str(own)} if in_loop else {})}


def processors() -> str:
    """Where this thread may run, for people."""
    return ",".join(map(str, sorted(os.sched_getaffinity(0))))


def _keep_to(wanted: str) -> None:
    with contextlib.suppress(OSError, ValueError):  # it may have been taken away meanwhile: it runs where it may
        if wanted:
            os.sched_setaffinity(0, {int(each) for each in wanted.split(",")})
