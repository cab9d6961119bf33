"""Calls of agents' tools that end with their client: by a closed connection, or by the protocol's cancellation."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable
from typing import Any, TypeVar

from fastapi import Request, Response
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from starlette.types import Message, Receive, Scope, Send

from skiros2_common.core.errors import Refused
from skiros2_gateway.core.access import Caller

T = TypeVar("T")


class Calls:
    """The requests of agents' clients that are being answered, by user and by the id that the client gave them."""

    def __init__(self) -> None:
        self._open: dict[tuple[str, str], set[asyncio.Event]] = {}

    async def answer(self, request: Request, caller: Caller, manager: StreamableHTTPSessionManager) -> Response:
        """Returns the answer of the protocol's session manager to a request.

        `request.state` gets the `caller`, and `gone`: an event that is set when the client has gone.
        """
        body = await request.body()
        method, number = _identity(body)
        gone = asyncio.Event()
        request.state.caller, request.state.gone = caller, gone
        if method == "notifications/cancelled":
            for event in self._open.get((caller.user, number), ()):
                event.set()
        return _Answer(self, (caller.user, number), manager, body, gone)

    def begin(self, key: tuple[str, str], gone: asyncio.Event) -> None:
        self._open.setdefault(key, set()).add(gone)

    def end(self, key: tuple[str, str], gone: asyncio.Event) -> None:
        events = self._open.get(key, set())
        events.discard(gone)
        if not events:
            self._open.pop(key, None)


class _Answer(Response):
    """An answer that the session manager gives."""

    def __init__(
        self,
        calls: Calls,
        key: tuple[str, str],
        manager: StreamableHTTPSessionManager,
        body: bytes,
        gone: asyncio.Event,
    ) -> None:
        super().__init__()
        self._calls = calls
        self._key = key
        self._manager = manager
        self._body_read = body
        self._gone = gone

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_read = False

        async def replay() -> Message:
            nonlocal is_read
            if is_read:
                await self._gone.wait()
                return {"type": "http.disconnect"}
            is_read = True
            return {"type": "http.request", "body": self._body_read, "more_body": False}

        async def watch() -> None:
            while (await receive())["type"] != "http.disconnect":
                pass
            self._gone.set()

        watcher = asyncio.ensure_future(watch())
        self._calls.begin(self._key, self._gone)
        try:
            await self._manager.handle_request(scope, replay, send)
        finally:
            watcher.cancel()
            self._calls.end(self._key, self._gone)


async def until_gone(work: Awaitable[T], gone: asyncio.Event) -> T:
    """Awaits work, and cancels it when its client has gone.

    :raises Refused: the client has gone.
    """
    task = asyncio.ensure_future(work)
    watcher = asyncio.ensure_future(gone.wait())
    try:
        await asyncio.wait((task, watcher), return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            return task.result()
    finally:
        watcher.cancel()
        task.cancel()
    try:
        return await task  # what must not be left half-done ends first
    except asyncio.CancelledError:
        raise Refused("the client has gone") from None


def _identity(body: bytes) -> tuple[str, str]:
    """Returns the method of a message, and the id of the request that it is, or is about; "" for none."""
    try:
        message: Any = json.loads(body)
    except (ValueError, RecursionError):
        return "", ""
    if not isinstance(message, dict):
        return "", ""
    params = message.get("params")
    about = params.get("requestId") if isinstance(params, dict) else None
    method = str(message.get("method", ""))
    return method, json.dumps(about if method == "notifications/cancelled" else message.get("id"))
