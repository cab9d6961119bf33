"""Answers of ASCII characters: in a terminal, a name with marks that reverse text looks like no other one."""

from __future__ import annotations

import json
import re

from starlette.types import ASGIApp, Message, Receive, Scope, Send

_OTHER = re.compile(r"[^\x00-\x7e]")


class AsciiAnswers:
    """Writes other characters of answers in JSON as codes. The data stay the same."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        start: Message | None = None

        async def answer(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start" and _is_json(message):
                start = message  # its length is not known yet
                return
            if start is not None:
                if not message.get("more_body"):
                    body = message["body"] = _ascii(message.get("body", b""))
                    others = [header for header in start["headers"] if header[0] != b"content-length"]
                    start["headers"] = [*others, (b"content-length", str(len(body)).encode())]
                await send(start)
                start = None
            await send(message)

        await self._app(scope, receive, answer)


def _is_json(start: Message) -> bool:
    kinds = [value for name, value in start["headers"] if name == b"content-type"]
    return any(b"json" in kind for kind in kinds)


def _ascii(body: bytes) -> bytes:
    if body.isascii() and b"\x7f" not in body:
        return body
    return _OTHER.sub(lambda found: json.dumps(found[0])[1:-1], body.decode()).encode()
