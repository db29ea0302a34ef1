"""A real-time priority for the processes of the loop, as ros2_control's controller manager asks for one."""

from __future__ import annotations

import contextlib
import os

PRIORITY = 10
"""Above all that has none, below the interrupts' threads of a real-time kernel (50)."""


def take_priority() -> None:
    """Run before whatever has no such priority (SCHED_RR), where bringup wants it and the system allows it.

    Threads that are started later have it, too. Who was started with one, as by `chrt`, keeps his own.
    """
    if os.environ.get("PZT_PRIORITY") == "1" and os.sched_getscheduler(0) == os.SCHED_OTHER:
        with contextlib.suppress(OSError):  # neither root nor `ulimit -r`: it just runs later when others want to
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))


def priority() -> str:
    """What this thread has, for people."""
    names = {os.SCHED_RR: "SCHED_RR", os.SCHED_FIFO: "SCHED_FIFO"}
    policy = os.sched_getscheduler(0)
    return f"{names[policy]} {os.sched_getparam(0).sched_priority}" if policy in names else "normal"
