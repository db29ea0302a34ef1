"""Runs the page: the web server, the feed beside it, and an end that leaves the stage as it is."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from fastapi import Response
from fastapi.responses import FileResponse, PlainTextResponse
from nicegui import app, background_tasks, ui

from pzt_ros.panel.access import Guard
from pzt_ros.panel.board import Board
from pzt_ros.panel.feed import Feed
from pzt_ros.panel.frames import Row
from pzt_ros.panel.page import Page
from pzt_ros.panel.reports import REPORT_PATH, Reports

Beside = Callable[[Board], Awaitable[None]]
"""Something that runs beside the feed and may end the board, such as the watch over a graph."""


def serve(
    feed: Feed, *, host: str, port: int, token: str = "", show: bool = False, folder: Path | None = None,
    beside: Beside | None = None,
) -> None:  # fmt: skip
    """Serve the panel until it is stopped (Ctrl-C).

    Args:
        feed: where data come from and requests go.
        host, port: to bind to.
        token: that a page must show; empty for none.
        show: open a browser.
        folder: where reports of diagnoses are looked for; here by default.
        beside: run beside the feed.
    """
    board, reports = Board(), Reports(folder or Path.cwd())
    app.add_middleware(Guard, host=host, token=token)

    def page() -> None:
        shown = Page(board, feed, reports)

        def push(rows: list[Row]) -> None:
            shown.show(rows)

        board.listeners.append(push)
        ui.context.client.on_delete(lambda: board.listeners.remove(push))

    async def start() -> None:
        _hear_once()
        for task in (feed.run(board), beside(board) if beside else None):
            if task is not None:
                background_tasks.create(_seen_through(task, board))

    async def report() -> Response:
        latest = await asyncio.to_thread(lambda: reports.latest)
        return FileResponse(latest) if latest else PlainTextResponse("no diagnosis yet: run pzt diagnose", 404)

    app.add_api_route(REPORT_PATH, report)
    app.on_startup(start)
    app.on_shutdown(feed.close)
    ui.run(
        page, host=host, port=port, title="pzt panel", reconnect_timeout=RECONNECT,
        show=f"/?token={token}" if show and token else show,
        reload=False, show_welcome_message=False, dark=None, favicon=ICON, tailwind=False, gzip_middleware_factory=None,
    )  # fmt: skip


RECONNECT = 30.0
"""A page that loses its connection for less than this [s], on a busy machine, goes on with what was typed into it."""

ICON = (
    "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 32 32'><rect width='32' height='32' rx='7' fill='#0072b2'/>"
    "<path d='M5 23C14 23 12 9 27 9C18 9 20 23 5 23' fill='none' stroke='#fff' stroke-width='2.6'/></svg>"
)
"""A hysteresis loop."""


def _hear_once() -> None:
    """Ctrl-C pressed again while the server ends is ignored: it would leave out what the end consists of."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, partial(_ending, then=signal.getsignal(number)))


def _ending(number: int, frame: FrameType | None, then: Any) -> None:
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, signal.SIG_IGN)  # until the server puts back what there was before it
    then(number, frame)


async def _seen_through(task: Any, board: Board) -> None:
    """A feed that fails says so on the page; the page stays."""
    try:
        await task
    except Exception as error:  # whatever it is, the person at the page has to know
        board.end("fault", "NO CONNECTION", f"{type(error).__name__}: {error}")
        raise
