"""Turns of the executor for what has to wait until others had theirs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any


class Turns:
    """Calls made in turns of their own, each after all that was due when it was asked for."""

    def __init__(self) -> None:
        self.failure: Exception | None = None
        self._executor: Any = None
        self._early: list[Callable[[], Any]] = []

    @contextmanager
    def of(self, executor: Any) -> Iterator[None]:
        """Take the turns of this executor while `with` lasts; nothing is left of it afterwards."""
        self._executor = executor
        for call in self._early:
            self.take(call)
        self._early.clear()
        try:
            yield
        finally:
            self._executor = None

    def take(self, call: Callable[[], Any]) -> None:
        """Make a call in a turn of its own; before there is an executor, in its first ones."""
        if self._executor is None:
            self._early.append(call)
        else:
            self._executor.create_task(partial(self._do, call))

    def _do(self, call: Callable[[], Any]) -> None:
        """A failure is kept for the spinner, and is the end: raised here it would end the process by a signal."""
        if self.failure is None:
            try:
                call()
            except Exception as error:
                self.failure = error
