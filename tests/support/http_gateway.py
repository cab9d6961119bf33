"""The gateway's HTTP server in the test's own loop, called by curl."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

from fastapi import APIRouter, FastAPI

from skiros2_gateway.core.service import Service
from skiros2_gateway.http.app import create_app
from skiros2_gateway.http.server import HttpServer, Limits


@asynccontextmanager
async def served(
    service: Service, max_body: int = 10_000, routers: Sequence[APIRouter] = (), limits: Limits | None = None
) -> AsyncIterator[str]:
    """Serves the gateway's application until the block ends; yields the address."""
    async with served_app(create_app(service, routers, max_body=max_body), limits) as address:
        yield address


@asynccontextmanager
async def served_app(app: FastAPI, limits: Limits | None = None) -> AsyncIterator[str]:
    """Serves an application until the block ends; yields the address."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    sock.bind(("127.0.0.1", 0))
    sock.listen(100)
    server = HttpServer(app, sock, limits=limits)
    server.start()
    try:
        yield f"http://127.0.0.1:{sock.getsockname()[1]}"
    finally:
        await server.stop(at_once=True)


async def curl(address: str, path: str, *options: str, token: str = "", body: Any = None) -> tuple[int, Any]:
    """Returns the status and the JSON answer of a request."""
    command = ["curl", "-sS", "-m", "60", "-w", "\n%{http_code}", *options, address + path]
    if token:
        command += ["-H", f"Authorization: Bearer {token}"]
    if body is not None:
        text = body if isinstance(body, str) else json.dumps(body)
        command += ["-H", "Content-Type: application/json", "--data-binary", text]
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    out, _ = await process.communicate()
    text, _, status = out.decode().rpartition("\n")
    return int(status), json.loads(text) if text.startswith(("{", "[")) else text
