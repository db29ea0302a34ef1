"""Holds ticks back until the amplifier says that it follows commands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any


class Gate:
    """Lets a tick through if the amplifier was enabled before its block was put out.

    What the amplifier says of itself comes over another topic than its blocks, before them or after: the last tick
    waits until it is known, and ticks of the ramp to 0 V, or of a time before, never get through.
    """

    def __init__(self, callback: Callable[[int, Any], None]) -> None:
        self._callback = callback
        self._first: int | None = None
        self._waiting: tuple[int, Any] | None = None
        self.is_open = False
        """Whether commands are followed, and the first tick has got through."""

    def hear(self, amplifier: Mapping[str, str]) -> None:
        """What the amplifier says of itself in its diagnostics."""
        enabled = amplifier.get("state") == "enabled" and amplifier.get("enabled_at_block", "").isdigit()
        first = int(amplifier["enabled_at_block"]) if enabled else None
        if first != self._first:
            self._first, self.is_open = first, False
        self._let_through()

    def add(self, tick: int, blocks: Any) -> None:
        """A tick is complete."""
        self._waiting = tick, blocks
        self._let_through()

    def _let_through(self) -> None:
        if self._first is None or self._waiting is None:
            return
        tick, blocks = self._waiting
        self._waiting = None
        if tick >= self._first:
            self.is_open = True
            self._callback(tick, blocks)
