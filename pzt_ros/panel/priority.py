"""A panel is for looking on: the graph's nodes go first."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

BEHIND = 5
"""A third of the share that others have: at the lowest priority, 19, a machine that compiles left the panel's node
nothing for minutes, and nobody could press Disable."""


def stand_back() -> None:
    """Let others go first where time is short, and never wake in their midst; where a system forbids it, go on as ever.

    Linux on a desktop shares time out between sessions first and only then by niceness (sched(7), autogroup), so the
    session gets a small share as well, where it is this process' own.
    """
    with contextlib.suppress(OSError):
        os.nice(BEHIND)
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        if os.getsid(0) == os.getpid():
            Path("/proc/self/autogroup").write_text(str(BEHIND), encoding="ascii")
