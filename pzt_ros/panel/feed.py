"""Where the page's data come from and where its clicks go: a process that holds a ROS node, spoken to in lines of JSON.

Two processes, because the page then needs no ROS, and neither a slow page nor a crash of either can hold up the other.
"""

from __future__ import annotations

import asyncio
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from pzt_ros.panel.board import Board

PATIENCE = 6.0
"""A node of the graph that does not answer in this time [s] is said not to."""

LONGEST_LINE = 4 * 1024 * 1024


@dataclass(frozen=True)
class Answer:
    """What came of a request, in words."""

    granted: bool
    message: str


class Feed(Protocol):
    """Fills a board, and takes requests where it can."""

    read_only: bool

    async def run(self, board: Board) -> None:
        """Fill the board until the source is exhausted."""

    async def ask(self, request: Mapping[str, Any]) -> Answer:
        """Pass on a request: {"do": name, ...}, see `pzt_nodes.panel_node`."""

    async def close(self) -> None:
        """Let go of the source."""


class NodeFeed:
    """The panel's ROS node as a process of its own. It ends when its stdin is closed, whatever happens to the page."""

    def __init__(self, command: list[str], environment: Mapping[str, str], read_only: bool) -> None:
        self.read_only = read_only
        self._command = command
        self._environment = dict(environment)
        self._process: asyncio.subprocess.Process | None = None
        self._numbers = itertools.count(1)
        self._waiting: dict[int, asyncio.Future[Answer]] = {}

    async def run(self, board: Board) -> None:
        """Start the node and take in what it says, until it ends."""
        process = self._process = await asyncio.create_subprocess_exec(
            *self._command,
            env=self._environment,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=LONGEST_LINE,
            start_new_session=True,  # a group of its own for the scheduler (`priority.stand_back`)
        )
        assert process.stdout is not None
        async for line in process.stdout:
            self._take(line, board)
        code = await process.wait()
        for future in self._waiting.values():
            if not future.done():
                future.set_result(Answer(False, "the panel's node has ended; start the panel again"))
        if board.ended is None:
            board.end(
                "fault", "NO CONNECTION", f"the panel's ROS node has ended (exit code {code}); start the panel again"
            )

    def _take(self, line: bytes, board: Board) -> None:
        try:
            message = json.loads(line)
        except json.JSONDecodeError:
            return  # something that a library wrote to stdout
        if "answer" in message:
            future = self._waiting.pop(message["answer"], None)
            if future and not future.done():
                future.set_result(Answer(bool(message["granted"]), str(message["message"])))
        else:
            board.take(message)

    async def ask(self, request: Mapping[str, Any]) -> Answer:
        """Hand a request to the node and wait for what comes of it."""
        if self.read_only:
            return Answer(False, "this panel is read-only; start one without --read-only to command the stage")
        if self._process is None or self._process.stdin is None or self._process.returncode is not None:
            return Answer(False, "the panel's node is not running; start the panel again")
        number = next(self._numbers)
        future = self._waiting[number] = asyncio.get_running_loop().create_future()
        self._process.stdin.write(json.dumps({"id": number, **request}).encode() + b"\n")
        try:
            return await asyncio.wait_for(future, PATIENCE)
        except (TimeoutError, asyncio.TimeoutError):  # two classes before Python 3.11
            self._waiting.pop(number, None)
            return Answer(False, f"no answer to '{request['do']}' within {PATIENCE:.0f} s; is its node alive?")

    async def close(self) -> None:
        """Close the node's stdin, and see it out."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            await asyncio.wait_for(process.wait(), 5.0)
        except (TimeoutError, asyncio.TimeoutError):
            process.kill()
