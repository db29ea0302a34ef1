"""A panel is for looking on: the graph's nodes go first."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

LOWEST = 19


def stand_back() -> None:
    """Take processor time only where nobody else wants it; a system that does not allow that goes on as it was.

    Linux on a desktop shares time out between sessions first and only then by niceness (sched(7), autogroup), so the
    session gets the lowest share as well, where it is this process' own.
    """
    with contextlib.suppress(OSError):
        os.nice(LOWEST)
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        if os.getsid(0) == os.getpid():
            Path("/proc/self/autogroup").write_text(str(LOWEST), encoding="ascii")
