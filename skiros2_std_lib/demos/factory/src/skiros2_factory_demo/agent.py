"""An agent that asks for a job, with the client of the Model Context Protocol."""

from __future__ import annotations

from typing import Any

import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from skiros2_common.core.errors import Refused

_TIMEOUT = 120.0  # s, with the wait for a person


async def ask_for_job(address: str, token: str, order: dict[str, Any], reason: str) -> None:
    """Asks for a job, which starts when a person approves it.

    :param address: of the gateway.
    :param token: of a user with the role agent.
    :raises Refused: the gateway or the person refuses.
    """
    async with (
        httpx2.AsyncClient(headers={"Authorization": f"Bearer {token}"}, timeout=_TIMEOUT) as http,
        Client(streamable_http_client(f"{address}/mcp", http_client=http)) as client,
    ):
        answer = await client.call_tool("execute", {**order, "reason": reason})
        if answer.is_error:
            raise Refused(f"the agent's job: {answer.structured_content or answer.content}")
