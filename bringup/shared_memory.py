"""Removes the shared memory of processes that were killed; who ends by himself removes his own."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
from collections.abc import Iterable
from pathlib import Path

FOLDER = Path("/dev/shm")

_LOCK = re.compile(r"(fastrtps_(?:[0-9a-f]{16}|port\d{1,5}))_[es]l")
"""Fast DDS keeps a lock file beside every segment and every port, and holds its lock as long as the owner lives."""


def held_by(pid: int) -> set[str]:
    """The segments and ports whose lock files a process has open; none where that cannot be seen."""
    found = set()
    with contextlib.suppress(OSError):
        for link in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                file = Path(os.readlink(link))
                if file.parent == FOLDER and (named := _LOCK.fullmatch(file.name)):
                    found.add(named[1])
    return found


def sweep(names: Iterable[str], folder: Path = FOLDER) -> list[str]:
    """Remove those of these segments and ports that have no owner any more; returns their names.

    The test is that of Fast DDS' own `fastdds shm clean`: a lock that can be had has no owner. To be done when all
    processes of the graph have ended: a living one that still has messages for a dead one makes its port anew, without
    a lock. A port may have a new owner by now, who holds its lock.
    """
    return sorted(name for name in names if _remove_if_dead(folder, name))


def _remove_if_dead(folder: Path, name: str) -> bool:
    files = (folder / name, folder / f"{name}_el", folder / f"{name}_sl", folder / f"sem.{name}_mutex")
    there = [path for path in files if path.exists()]
    try:
        with contextlib.ExitStack() as held:
            for lock in (path for path in there if path.name.endswith("l")):
                fcntl.flock(held.enter_context(lock.open("rb")), fcntl.LOCK_EX | fcntl.LOCK_NB)
            for path in there:
                path.unlink(missing_ok=True)
    except OSError:  # its owner lives, or it is not ours to remove
        return False
    return bool(there)
