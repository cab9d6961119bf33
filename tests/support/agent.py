"""An agent: a client of the gateway's tools over the Model Context Protocol."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from support.job_cell import TOKENS, JobCell
from support.programs import PATIENCE


@asynccontextmanager
async def connected_agent(cell: JobCell) -> AsyncIterator[Callable[..., Awaitable[Any]]]:
    """Connects an agent. Yields a function that calls a tool and returns its data."""
    headers = {"Authorization": f"Bearer {TOKENS['agent']}"}
    async with (
        httpx2.AsyncClient(headers=headers, timeout=PATIENCE) as http,
        Client(streamable_http_client(f"{cell.rest.address}/mcp", http_client=http)) as client,
    ):

        async def call(tool: str, **arguments: Any) -> Any:
            return (await client.call_tool(tool, arguments)).structured_content

        yield call
