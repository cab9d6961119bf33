"""The stop port: `POST /api/robots/{action}` in a process of its own, which nothing else of the gateway uses."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlsplit

from fastapi import FastAPI, Request, Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_gateway.core.access import RateLimit
from skiros2_gateway.core.deadline import remaining
from skiros2_gateway.core.keys import KeyMemory, Keys
from skiros2_gateway.core.problems import Denied, Unauthenticated
from skiros2_gateway.core.refusals import Refusals
from skiros2_gateway.core.service import ROBOT_ACTIONS
from skiros2_gateway.http.body_limit import BodyLimit
from skiros2_gateway.http.callers import COOKIE, address_of, set_known, token_of
from skiros2_gateway.http.deadlines import Deadlines
from skiros2_gateway.http.errors import add_error_handlers, on_skiros_error
from skiros2_gateway.http.once import HEADER
from skiros2_gateway.ros.robot_stops import RobotStops

#: Requests with wrong credentials of one address, per second and in a burst; how many addresses are kept.
_FAILURES_RATE, _FAILURES_BURST, _MAX_ADDRESSES = 1.0, 20, 1000

#: Writes to the audit log: user, way, action, object, outcome.
Audit = Callable[[dict[str, str]], None]


class Users:
    """The users that may stop robots: names by the SHA-256 of tokens and of the secrets of sessions.

    Call `close` at the end.

    :param audit: gets failed logins: of those of a minute the first, and how many followed.
    """

    def __init__(self, audit: Audit) -> None:
        self.by_digest: dict[str, str] = {}
        self._refusals = Refusals(lambda entry: audit(dict(entry)))
        self._failures: dict[str, RateLimit] = {}

    def close(self) -> None:
        """Writes what is only counted so far."""
        self._refusals.write_ended(also_open=True)

    def authenticate(self, request: Request) -> tuple[str, str]:
        """Returns the user and the way.

        :raises Unauthenticated: the user is unknown, or may not command.
        :raises TooMany: there were too many of these from this address.
        """
        token, cookie = token_of(request), request.cookies.get(COOKIE, "")
        way = "rest" if token else "browser"
        if not token and cookie and request.headers.get("x-gateway") != "1":
            raise Unauthenticated("a command with the cookie needs the header X-Gateway: 1")
        secret = (token or cookie).encode("utf-8", "surrogatepass")
        user = self.by_digest.get(hashlib.sha256(secret).hexdigest())
        if user is None:
            if len(self._failures) >= _MAX_ADDRESSES:
                self._failures.clear()
            limit = RateLimit(_FAILURES_RATE, _FAILURES_BURST)
            reason = "the token or session is unknown here, or its user may not command"
            entry = {"user": "", "way": way, "action": "log in", "object": address_of(request), "outcome": reason}
            self._refusals.add(entry)
            self._failures.setdefault(address_of(request), limit).take()
            raise Unauthenticated(reason)
        set_known(request)
        return user, way


class _Robots(BaseModel):
    model_config = ConfigDict(extra="forbid")
    robots: list[str] = Field([], max_length=1000)
    task: int = Field(-1, ge=-1, lt=2**15)


class _Origins:
    """Admits pages of the same host, whatever their port; refuses those of others."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        origin = request.headers.get("origin")
        headers: list[tuple[bytes, bytes]] = [(b"vary", b"Origin")]
        if origin is not None:
            if _host(origin) != _host(f"//{request.headers.get('host', '')}"):
                error = Denied(f"the request comes from a page of {origin[:100]!r}")
                await (await on_skiros_error(request, error))(scope, receive, send)
                return
            headers += [
                (b"access-control-allow-origin", origin.encode("latin-1")),
                (b"access-control-allow-credentials", b"true"),
                (b"access-control-allow-headers", b"content-type, x-gateway, x-deadline, idempotency-key"),
                (b"access-control-max-age", b"600"),
            ]

        async def answer(message: Message) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *headers]
            await send(message)

        if request.method == "OPTIONS":
            await Response(status_code=204)(scope, receive, answer)
        else:
            await self._app(scope, receive, answer)


def _host(url: str) -> str | None:
    try:
        return urlsplit(url).hostname
    except ValueError:
        return None


def create_stop_app(stops: RobotStops, users: Users, audit: Audit) -> FastAPI:
    """Returns the application."""
    keys = Keys(KeyMemory())
    app = FastAPI(title="SkiROS2 gateway: stop", docs_url=None, redoc_url=None, openapi_url=None)
    add_error_handlers(app)
    app.add_middleware(Deadlines, on_error=on_skiros_error)
    app.add_middleware(_Origins)
    app.add_middleware(BodyLimit)

    @app.get("/api/health")
    async def health() -> dict[str, Any]:
        return {"status": "running", "robots": stops.robots, "clock": time.monotonic()}

    @app.post("/api/robots/{action}")
    async def command(request: Request, action: str, body: _Robots) -> dict[str, int]:
        user, way = users.authenticate(request)
        if action not in ROBOT_ACTIONS:
            raise UnknownName(f"there is no action {action!r}; there are: {', '.join(ROBOT_ACTIONS)}")
        thing = " ".join(body.robots)[:200] + (f" task {body.task}" if body.task >= 0 else "")
        entry = {"user": user, "way": way, "action": f"{action} robots", "object": thing}

        async def carry_out() -> dict[str, int]:
            try:
                done = await stops.command(action, body.robots, user, body.task, remaining())
            except SkirosError as error:
                audit({**entry, "outcome": f"{error.code}: {error}"[:500]})
                raise
            audit({**entry, "outcome": "done"})
            return done

        if action == "stop":  # each time: nothing is unsafe about that, but something is about the opposite
            return await carry_out()
        key = request.headers.get(HEADER, "")
        found: dict[str, int] = await keys.once(user, key, [action, body.model_dump()], carry_out)
        return found

    return app
