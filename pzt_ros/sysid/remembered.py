"""What was computed lately, kept for those who ask again; candidates are refitted in threads that share it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Remembered(Generic[Value]):
    """The last few values by key, shared by threads; a copy in another process starts empty.

    Args:
        most: values that are kept; the oldest goes first.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._values: dict[bytes, Value] = {}
        self._lock = threading.Lock()

    def get(self, key: bytes, compute: Callable[[], Value]) -> Value:
        """The value of a key, computed where it is not known (by two threads at once at worst)."""
        with self._lock:
            if key in self._values:
                return self._values[key]
        value = compute()
        with self._lock:
            self._values[key] = value
            while len(self._values) > self._most:
                del self._values[next(iter(self._values))]
        return value

    def __reduce__(self) -> tuple[type[Remembered[Value]], tuple[int]]:
        return type(self), (self._most,)
