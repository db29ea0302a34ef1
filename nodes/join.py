"""Waits until the blocks of one tick have all arrived, in whatever order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Join:
    """Collects one item per name for each tick; calls back, in order of ticks, when a tick is complete.

    Ticks are numbered by the block just measured. A tick that is overtaken by a complete one is dropped and counted.
    """

    def __init__(self, names: tuple[str, ...], callback: Callable[[int, dict[str, Any]], None]) -> None:
        self.names = names
        self.dropped = 0
        self._callback = callback
        self._waiting: dict[int, dict[str, Any]] = {}
        self._last = -1

    def add(self, tick: int, name: str, item: Any) -> None:
        """Take in one item of a tick; items of ticks that are over are ignored."""
        if tick <= self._last:
            return
        parts = self._waiting.setdefault(tick, {})
        parts[name] = item
        if len(parts) == len(self.names):
            self._last = tick
            for old in [t for t in self._waiting if t <= tick]:
                self.dropped += old != tick
                del self._waiting[old]
            self._callback(tick, parts)
