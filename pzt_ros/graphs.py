"""Which graphs run on this machine: each bringup holds a lock file that names its ROS domain."""

from __future__ import annotations

import fcntl
import re
import tempfile
from pathlib import Path

_NAME = "pzt_ros_domain_{}.lock"


def lock_file(domain: int) -> Path:
    """Held by the bringup that runs in a domain, and by nobody else; its process id is in it."""
    return Path(tempfile.gettempdir()) / _NAME.format(domain)


def running_graphs() -> dict[int, int]:
    """Domain -> process id of every bringup that runs on this machine; another user's have the id 0."""
    found: dict[int, int] = {}
    for path in Path(tempfile.gettempdir()).glob(_NAME.format("*")):
        number = re.search(r"_(\d+)\.lock$", path.name)
        if number and (holder := _holder(path)) is not None:
            found[int(number[1])] = holder
    return dict(sorted(found.items()))


def _holder(path: Path) -> int | None:
    try:
        with path.open("r", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                text = file.read().strip()
                return int(text) if text.isdigit() else 0
    except OSError:
        return None  # another user's; whether it is held cannot be seen
    return None
