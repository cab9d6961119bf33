"""The Model Context Protocol at `/mcp` of the HTTP server, and the routes by which people approve what agents ask for.

An agent authenticates like every client: `Authorization: Bearer TOKEN`. Results are JSON, as text and as structured
content; an error has `code`, `detail` and `problems`, as of REST.
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from typing import Any

from fastapi import APIRouter, Request, Response
from mcp import types
from mcp.server import Server
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from starlette.types import Receive, Scope, Send

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_gateway.agents.tools import Tools
from skiros2_gateway.core.access import Role
from skiros2_gateway.core.approvals import Approvals
from skiros2_gateway.core.problems import Rejected
from skiros2_gateway.core.service import Service
from skiros2_gateway.http.app import CallerArg, ServiceArg, agent_of
from skiros2_gateway.http.origin import check_origin

_INSTRUCTIONS = (
    "Robots with skills. Read the skills and the world first; plan and preview a goal before you execute it. execute "
    "waits until a person approves the plan."
)


class AgentServer:
    """The server. To be used in the gateway's loop, within `running`.

    :param max_body: the largest request (bytes).
    :param hosts: names of this machine by which agents reach it, beside its host name.
    """

    def __init__(
        self, service: Service, approvals: Approvals, max_body: int = 256 * 1024, hosts: Collection[str] = ()
    ) -> None:
        self._hosts = hosts
        self._tools = Tools(service, approvals)
        self._approvals = approvals
        server: Server[Any] = Server(
            "skiros2",
            version="1",
            instructions=_INSTRUCTIONS,
            on_list_tools=self._list_tools,
            on_call_tool=self._call_tool,
        )
        self._manager = StreamableHTTPSessionManager(
            server, json_response=True, stateless=True, max_request_body_size=max_body
        )

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Serves the requests of the routes until the block ends."""
        async with self._manager.run():
            yield

    def router(self) -> APIRouter:
        """Returns the routes: `/mcp`, and `/api/approvals`."""
        router = APIRouter()

        @router.api_route("/mcp", methods=["GET", "POST", "DELETE"], include_in_schema=False)
        async def endpoint(request: Request) -> Response:
            check_origin(request, self._hosts)
            request.state.caller = agent_of(request)
            return _Handled(self._manager)

        @router.get("/api/approvals")
        async def approvals(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
            """What agents ask for: {approvals: [{number, user, what, created}]}; `what` has order, goal and plan."""
            service.view(caller)
            return {"approvals": [approval.to_dict() for approval in self._approvals.open]}

        @router.post("/api/approvals/{number}/{answer}")
        async def answer(caller: CallerArg, service: ServiceArg, number: int, answer: str) -> dict[str, Any]:
            """Approves or rejects what an agent asks for: answers approve and reject. Not by the agent's own user."""
            if answer not in ("approve", "reject"):
                raise UnknownName(f"there is no answer {answer!r}; there are: approve, reject")
            with service.audited(caller, answer, str(number), Role.APPROVE):
                return self._approvals.answer(caller, number, answer == "approve").to_dict()

        return router

    async def _list_tools(self, _: Any, __: Any) -> types.ListToolsResult:
        tools = [
            types.Tool(
                name=tool.name,
                description=tool.description,
                input_schema=tool.arguments.model_json_schema(),
                annotations=types.ToolAnnotations(read_only_hint=not tool.moves, destructive_hint=tool.moves),
            )
            for tool in self._tools.all.values()
        ]
        return types.ListToolsResult(tools=tools)

    async def _call_tool(self, context: Any, params: types.CallToolRequestParams) -> types.CallToolResult:
        try:
            data = await self._tools.call(context.request.state.caller, params.name, params.arguments or {})
            is_error = False
        except SkirosError as error:
            problems = [each.to_dict() for each in error.problems] if isinstance(error, Rejected) else []
            data, is_error = {"code": error.code, "detail": str(error), "problems": problems}, True
        text = json.dumps(data, default=str)
        content = [types.TextContent(type="text", text=text)]
        return types.CallToolResult(content=content, structured_content=json.loads(text), is_error=is_error)


class _Handled(Response):
    """An answer that the session manager of the protocol gives."""

    def __init__(self, manager: StreamableHTTPSessionManager) -> None:
        super().__init__()
        self._manager = manager

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._manager.handle_request(scope, receive, send)
