"""A page as the panel sees one on another computer: it takes every frame over the websocket, and draws none.

`python -m pzt_benchmarks.page_elsewhere PORT` answers each line on stdin with the number of frames so far.
"""

from __future__ import annotations

import ast
import asyncio
import re
import sys
import urllib.request
from typing import Any
from uuid import uuid4

import socketio

QUERY = re.compile(r"query: (\{.*\}),$", re.MULTILINE)
"""Where a page of NiceGUI says what its websocket is opened with."""
ACKNOWLEDGED = 3.0
"""A page says as often what it has received [s]."""


async def stay(port: int) -> None:
    """Open the page's websocket and count frames until stdin ends."""
    frames, following = 0, 0
    address = f"http://127.0.0.1:{port}"
    page = await asyncio.to_thread(lambda: urllib.request.urlopen(address).read().decode())
    found = QUERY.search(page)
    assert found, "the page does not say what its websocket is opened with"
    query = {**ast.literal_eval(found[1]), "document_id": str(uuid4()), "tab_id": str(uuid4()), "old_tab_id": ""}
    words = "&".join(f"{name}={str(value).lower()}" for name, value in query.items())
    client = socketio.AsyncClient()

    async def take(_event: str, data: Any) -> None:
        nonlocal frames, following
        following = data["_id"] + 1
        frames += '"push"' in str(data.get("code"))

    async def acknowledge() -> None:
        while True:
            await asyncio.sleep(ACKNOWLEDGED)
            await client.emit("ack", {"client_id": query["client_id"], "next_message_id": following})

    client.on("*", take)
    await client.connect(f"{address}?{words}", socketio_path="/_nicegui_ws/socket.io", transports=["websocket"])
    acknowledging = asyncio.create_task(acknowledge())
    while await asyncio.to_thread(sys.stdin.readline):
        print(frames, flush=True)
    acknowledging.cancel()
    await client.disconnect()


if __name__ == "__main__":
    asyncio.run(stay(int(sys.argv[1])))
