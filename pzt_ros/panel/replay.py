"""A recorded bag as if it happened now, read without ROS; nothing can be asked of it."""

from __future__ import annotations

import asyncio
import heapq
import math
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pzt_ros.bags.reader import open_bag
from pzt_ros.blocks import read_block
from pzt_ros.errors import BenchError
from pzt_ros.panel.board import Board
from pzt_ros.panel.feed import Answer
from pzt_ros.panel.frames import NEEDED, SOURCES, Frames
from pzt_ros.report.health import LEVELS

FRAME = 0.05
"""Between two frames [s]."""


class BagFeed:
    """Plays a bag at the pace of its own time stamps, once, from when the first page is open.

    Raises:
        BenchError: no bag, or the axis was not recorded in it.
    """

    read_only = True

    def __init__(self, path: Path, namespace: str = "/stage") -> None:
        self.path = path
        self._bag = open_bag(path)
        self._prefix = namespace.rstrip("/")
        present = {topic.name for topic in self._bag.topics() if topic.count}
        missing = [name for name in NEEDED if f"{self._prefix}/{name}" not in present]
        if missing:
            raise BenchError(
                f"{path}: no messages on {', '.join(f'{self._prefix}/{name}' for name in missing)}; "
                f"there are {', '.join(sorted(present)) or 'none'}; name the axis with --namespace"
            )
        self._simulated = f"{self._prefix}/truth" in present
        self._topics = [name for name in SOURCES if f"{self._prefix}/{name}" in present]
        self._has_health = "/diagnostics" in present

    async def run(self, board: Board) -> None:
        """Fill the board to the end of the bag."""
        board.take({"about": {"namespace": self._prefix, "simulated": self._simulated, "source": f"bag {self.path}"}})
        while not board.listeners:  # nobody looks yet
            await asyncio.sleep(FRAME)
        frames, began, due = Frames(), -math.inf, 0.0
        for topic, content in self._in_order():
            if topic == "/diagnostics":
                board.take({"health": health_of(content, self._prefix)})
                continue
            frames.add(topic, content)
            now = float(content.time[-1])
            if math.isinf(began):
                began, due = time.monotonic() - now, now
            if now >= due:
                board.take({"rows": frames.take()})
                due = now + FRAME
                await asyncio.sleep(max(began + now - time.monotonic(), 0.0))
        board.take({"rows": frames.take()})
        board.end("off", "REPLAY OVER", f"{self.path}; start the panel again to see it once more")

    def _in_order(self) -> Iterator[tuple[str, Any]]:
        """Blocks and diagnostics in the order of recording."""
        streams = [self._stream(name) for name in self._topics]
        if self._has_health:
            streams.append((when, "/diagnostics", message) for when, message in self._bag.messages("/diagnostics"))
        for _when, name, content in heapq.merge(*streams, key=lambda entry: entry[0]):
            yield name, content

    def _stream(self, name: str) -> Iterator[tuple[int, str, Any]]:
        for when, message in self._bag.messages(f"{self._prefix}/{name}"):
            yield when, name, read_block(message)

    async def ask(self, request: Mapping[str, Any]) -> Answer:
        """Refuse."""
        return Answer(False, f"'{request['do']}' is not possible: this is a recorded run")

    async def close(self) -> None:
        """Nothing to let go of."""


def health_of(message: Any, namespace: str) -> list[dict[str, Any]]:
    """What the nodes of one axis say in a DiagnosticArray."""
    found = []
    for status in message.status:
        axis, _, node = status.name.rpartition("/")
        if axis == namespace:
            level = status.level[0] if isinstance(status.level, bytes) else int(status.level)
            values = {pair.key: pair.value for pair in status.values}
            text = LEVELS[level] if level < len(LEVELS) else "error"
            found.append({"node": node, "level": text, "text": status.message, "values": values})
    return found
