"""The header `X-Deadline`: a command that arrives later is refused."""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.core.deadline import check_deadline, read_deadline, set_deadline


class Deadlines:
    """Sets the deadline of each request.

    :param on_error: answers a refused one.
    """

    def __init__(self, app: ASGIApp, on_error: Callable[[Request, Exception], Awaitable[Response]]) -> None:
        self._app = app
        self._on_error = on_error

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        text = dict(scope["headers"]).get(b"x-deadline") if scope["type"] == "http" else None
        set_deadline(math.inf)  # the context may be that of the connection's last request
        if text is not None:
            try:
                set_deadline(read_deadline(text.decode("latin-1")))
                check_deadline()
            except SkirosError as error:
                await (await self._on_error(Request(scope), error))(scope, receive, send)
                return
        await self._app(scope, receive, send)
