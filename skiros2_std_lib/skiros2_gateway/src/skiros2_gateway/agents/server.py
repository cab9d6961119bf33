"""The Model Context Protocol at `/mcp` of the HTTP server, and the routes by which people approve what agents ask for.

An agent authenticates like every client: `Authorization: Bearer TOKEN`. Results are JSON, as text and as structured
content; an error has `code`, `detail` and `problems`, as of REST.
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Collection
from contextlib import asynccontextmanager
from typing import Annotated, Any

from fastapi import APIRouter, Body, Request, Response
from mcp import types
from mcp.server import Server
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from pydantic import BaseModel, ConfigDict, Field

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_gateway.agents.calls import Calls, until_gone
from skiros2_gateway.agents.results import output_schema
from skiros2_gateway.agents.tools import Tools
from skiros2_gateway.core.access import Role
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.problems import Rejected
from skiros2_gateway.core.service import Service
from skiros2_gateway.http import models
from skiros2_gateway.http.callers import CallerArg, ServiceArg, agent_of
from skiros2_gateway.http.errors import answers
from skiros2_gateway.http.origin import check_origin

_INSTRUCTIONS = (
    "Robots with skills. Read the skills and the world first; plan and preview a goal before you execute it. execute "
    "waits until a person approves the plan."
)


class _Answer(BaseModel):
    """The digest of the request that a person has read, and why they answer so, which the agent learns."""

    model_config = ConfigDict(extra="forbid")
    digest: str = ""
    reason: str = Field("", max_length=1000)


_NO_REASON = _Answer()


class AgentServer:
    """The server. To be used in the gateway's loop, within `running`.

    :param max_body: the largest request (bytes).
    :param hosts: names of this machine by which agents reach it, beside its host name.
    """

    def __init__(self, service: Service, max_body: int = 256 * 1024, hosts: Collection[str] = ()) -> None:
        self._hosts = hosts
        self._tools = Tools(service)
        self._calls = Calls()
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
            return await self._calls.answer(request, agent_of(request), self._manager)

        @router.get("/api/approvals", responses=answers(models.Approvals))
        async def approvals(caller: CallerArg, service: ServiceArg) -> dict[str, Any]:
            """The open requests of agents: {approvals: [{id, digest, user, what, robots, reason, created, expires}]}.

            `what` has exactly what will run, of which `digest` is the SHA-256, and what a person should read beside it.
            """
            service.view(caller)
            return {"approvals": [approval.to_dict() for approval in service.approvals.open]}

        @router.post("/api/approvals/{approval_id}/{answer}", responses=answers(models.Approval, 404, 409))
        async def answer(
            caller: CallerArg,
            service: ServiceArg,
            approval_id: str,
            answer: str,
            body: Annotated[_Answer | None, Body()] = None,
        ) -> dict[str, Any]:
            """Approves or rejects what an agent asks for: answers approve and reject.

            Needs the role approve and an account that is marked as a person; not that of the agent.
            """
            if answer not in ("approve", "reject"):
                raise UnknownName(f"there is no answer {answer!r}; there are: approve, reject")
            given = body or _NO_REASON
            with service.audited(caller, answer, f"{approval_id} {given.digest}".strip(), Role.APPROVE):
                approvals, is_approved = service.approvals, answer == "approve"
                return approvals.answer(caller, approval_id, is_approved, given.digest, given.reason).to_dict()

        return router

    async def _list_tools(self, _: Any, __: Any) -> types.ListToolsResult:
        tools = [
            types.Tool(
                name=tool.name,
                description=tool.description,
                input_schema=tool.arguments.model_json_schema(),
                output_schema=output_schema(tool.name),
                annotations=types.ToolAnnotations(read_only_hint=not tool.moves, destructive_hint=tool.moves),
            )
            for tool in self._tools.all.values()
        ]
        return types.ListToolsResult(tools=tools)

    async def _call_tool(self, context: Any, params: types.CallToolRequestParams) -> types.CallToolResult:
        try:
            state = context.request.state
            work = self._tools.call(state.caller, params.name, params.arguments or {})
            data, is_error = await until_gone(work, state.gone), False
        except SkirosError as error:
            problems = [each.to_dict() for each in error.problems] if isinstance(error, Rejected) else []
            data, is_error = {"code": error.code, "detail": str(error), "problems": problems}, True
        text = json_text(data)
        content = [types.TextContent(type="text", text=text)]
        return types.CallToolResult(content=content, structured_content=json.loads(text), is_error=is_error)
