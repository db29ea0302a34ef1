"""Removes the shared memory of processes that were killed; who ends by himself removes his own."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
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


def left_over(folder: Path = FOLDER, for_at_least: float = 10.0) -> set[str]:
    """The segments and ports whose lock file has been there for so long [s], whether they have an owner or not.

    Younger ones may be just being made: Fast DDS makes the file first and takes its lock then.
    """
    found, before = set(), time.time() - for_at_least
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            with contextlib.suppress(OSError):  # gone meanwhile
                if (named := _LOCK.fullmatch(path.name)) and path.stat().st_mtime < before:
                    found.add(named[1])
    return found


def sweep(names: Iterable[str], folder: Path = FOLDER) -> list[str]:
    """Remove those of these segments and ports that have no owner any more; returns their names.

    The test is that of Fast DDS' own `fastdds shm clean`: a lock that can be had has no owner. To be done before a
    graph starts, as a port without an owner keeps whoever wants to write to it waiting for a second, and when all
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
