"""The header `Idempotency-Key`: a command that a client sends again with its key is answered as the first time."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

from fastapi import Request, Response
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from skiros2_common.core.errors import Refused, SkirosError, TimedOut
from skiros2_gateway.core.keys import MAX_KEY, Keep, keep_of
from skiros2_gateway.core.problems import Problem, Rejected
from skiros2_gateway.http.callers import caller_of, service_of

HEADER = "idempotency-key"
#: Questions: their answers, which may be large, are not kept.
_QUESTIONS = ("/api/plan", "/api/world/query")
#: Answered commands with these status codes may have been carried out, or are yet.
_UNKNOWN = (500, 503, 504)


class Once:
    """Carries out each command with a key once. Commands without a key, and all else, pass."""

    def __init__(self, app: ASGIApp, on_error: Callable[[Request, Exception], Awaitable[Response]]) -> None:
        """
        :param on_error: returns the answer for an error.
        """
        self._app = app
        self._on_error = on_error

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD") or not scope["path"].startswith("/api/"):
            await self._app(scope, receive, send)
            return
        request = Request(scope, receive)
        key = request.headers.get(HEADER)
        if key is None or scope["path"] == "/api/session":
            await self._app(scope, receive, send)
            return
        try:
            body = await request.body()
        except ClientDisconnect:
            return
        response: Response
        try:
            if not key or not key.isascii():
                expected = f"1 to {MAX_KEY} printable characters of ASCII"
                raise Rejected([Problem("wrong_value", "key", "the idempotency key is invalid", expected)])
            caller, service = caller_of(request), service_of(request)
            query = scope["query_string"].decode("latin-1")
            command = [scope["method"], scope["path"], query, hashlib.sha256(body).hexdigest()]
            carry_out = partial(_answer_of, self._app, scope, body)
            response = _response(await service.once(caller, key, command, carry_out, _keep(scope["path"])))
        except _Refused as error:
            response = _response(error.answer)
        except _Unknown as error:
            response = _response(error.answer)
        except SkirosError as error:
            response = await self._on_error(request, error)
        await response(scope, receive, send)


def _keep(path: str) -> Keep:
    if path in _QUESTIONS:
        return Keep.NOT
    return keep_of(path.rpartition("/")[2]) if path.startswith("/api/jobs/") else Keep.BEFORE


class _Refused(Refused):
    """An answer with an error; nothing has changed."""

    def __init__(self, answer: dict[str, Any]) -> None:
        super().__init__(answer["body"])
        self.answer = answer


class _Unknown(TimedOut):
    """An answer with an error, although the command may have been carried out."""

    def __init__(self, answer: dict[str, Any]) -> None:
        super().__init__(answer["body"])
        self.answer = answer


async def _answer_of(app: ASGIApp, scope: Scope, body: bytes) -> dict[str, Any]:
    """Returns status, media type, headers and body of the answer to a request.

    :raises _Refused, _Unknown: the answer is an error.
    """
    answer: dict[str, Any] = {"status": 500, "headers": {}, "body": ""}

    async def receive() -> Message:
        return {"type": "http.request", "body": body, "more_body": False}

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            answer["status"] = message["status"]
            kept = (b"content-type", b"retry-after")
            answer["headers"] = {k.decode(): v.decode() for k, v in message["headers"] if k in kept}
        else:
            answer["body"] += message.get("body", b"").decode()

    await app(scope, receive, send)
    if answer["status"] in _UNKNOWN and not _has_code(answer["body"], "store_failed"):
        raise _Unknown(answer)
    if answer["status"] >= 400:
        raise _Refused(answer)
    return answer


def _has_code(body: str, code: str) -> bool:
    try:
        return bool(json.loads(body)["code"] == code)
    except (ValueError, TypeError, LookupError):
        return False


def _response(answer: dict[str, Any]) -> Response:
    return Response(answer["body"], answer["status"], answer["headers"])
