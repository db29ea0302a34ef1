"""Who may see the panel: everybody on this machine, others with a token; and no page of another site."""

from __future__ import annotations

import hmac
import secrets
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

HERE = ("127.0.0.1", "localhost", "::1")
"""Addresses that only this machine reaches."""

COOKIE = "pzt_panel_token"


def new_token() -> str:
    """A token that nobody guesses."""
    return secrets.token_urlsafe(16)


class Guard:
    """Around the whole web application, its websocket included.

    A request must come by an address that the panel was bound to (a name that another site made point here will not
    do), a websocket from the panel's own page, and where a token is wanted it must be in the address or in the cookie.
    """

    def __init__(self, app: Any, host: str, token: str) -> None:
        self._app = app
        self._host = host
        self._token = token

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or refuse it (ASGI)."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        problem = self._problem(headers, scope)
        if problem:
            await _refuse(scope, receive, send, problem)
            return
        await self._app(scope, receive, self._with_cookie(send) if self._token else send)

    def _problem(self, headers: dict[str, str], scope: Any) -> str:
        asked = headers.get("host", "")
        if self._host in HERE and urlsplit(f"//{asked}").hostname not in HERE:
            return f"this panel is bound to {self._host}, not to '{asked}'"
        origin = headers.get("origin", "")
        if origin and urlsplit(origin).netloc != asked:
            return f"a page of {origin} may not speak to this panel"
        if self._token and not self._knows_token(headers, scope):
            return "open the panel with the address that it printed: the token is missing or wrong"
        return ""

    def _knows_token(self, headers: dict[str, str], scope: Any) -> bool:
        cookies = SimpleCookie(headers.get("cookie", ""))
        shown = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[0]
        kept = cookies[COOKIE].value if COOKIE in cookies else ""
        return any(hmac.compare_digest(self._token.encode(), given.encode()) for given in (shown, kept))

    def _with_cookie(self, send: Any) -> Any:
        async def sending(message: Any) -> None:
            if message["type"] == "http.response.start":
                cookie = f"{COOKIE}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                message = {**message, "headers": [*message.get("headers", []), (b"set-cookie", cookie.encode())]}
            await send(message)

        return sending


async def _refuse(scope: Any, receive: Any, send: Any, problem: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": problem[:120]})
        return
    body = f"refused: {problem}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": body})
