"""Limits of the bodies of requests."""

from __future__ import annotations

import asyncio
import time

from fastapi import Request
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from skiros2_gateway.http.errors import on_http_error

#: The largest body of a request (bytes), and the longest time until it has arrived (s).
MAX_BODY, TIMEOUT = 256 * 1024, 30.0


class BodyLimit:
    """Refuses large and late bodies, and sets the headers that protect pages.

    :param max_body: the largest body of a request (bytes).
    """

    def __init__(self, app: ASGIApp, max_body: int = MAX_BODY) -> None:
        self._app = app
        self._max_body = max_body

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        received, is_complete, ended = 0, False, time.monotonic() + TIMEOUT

        async def limited() -> Message:
            nonlocal received
            nonlocal is_complete
            if is_complete:  # nothing but the end of the connection
                return await receive()
            try:
                message = await asyncio.wait_for(receive(), ended - time.monotonic())
            except TimeoutError:
                raise HTTPException(408, f"the body has not arrived within {TIMEOUT:g} s") from None
            is_complete = not message.get("more_body", False)
            received += len(message.get("body", b""))
            if received > self._max_body:
                raise HTTPException(413, f"the body has more than {self._max_body} bytes")
            return message

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *_HEADERS]
            await send(message)

        try:
            await self._app(scope, limited, guarded)
        except HTTPException as error:  # the body was read before a route was found
            await (await on_http_error(Request(scope), error))(scope, receive, send)


_HEADERS = [
    (b"x-content-type-options", b"nosniff"),
    (b"x-frame-options", b"DENY"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
]
