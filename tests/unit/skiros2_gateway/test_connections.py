"""Attacks on the HTTP server with connections: silent, slow, unread, without credentials."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest

from skiros2_gateway.http import body_limit
from skiros2_gateway.http.server import Limits
from support.http_gateway import curl, served
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]

GET = "GET {} HTTP/1.1\r\nHost: a\r\nAuthorization: Bearer {}\r\n\r\n"
BODY = b"POST /api/jobs HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{"


async def silent(address: str, count: int) -> list[Any]:
    """Opens connections that send nothing."""
    url = urlsplit(address)
    return [await asyncio.open_connection(url.hostname, url.port) for _ in range(count)]


@asynccontextmanager
async def opened(address: str, count: int, begin: bytes = b"") -> AsyncIterator[list[Any]]:
    """Opens connections that send the begin of something, and nothing more; closes them at the end."""
    found = await silent(address, count)
    for _, writer in found:
        writer.write(begin)
    yield found
    for _, writer in found:
        writer.close()


async def answered(writer: Any, reader: Any, text: bytes) -> bytes:
    writer.write(text)
    return await asyncio.wait_for(reader.read(100), 10.0)


def test_silent_connections_leave_room_for_requests(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service, limits=Limits(of_address=20)) as address, opened(address, 1005):
            assert (await curl(address, "/api/health"))[0] == 200
            assert (await curl(address, "/api/health", "--interface", "127.0.0.2"))[0] == 200

    in_gateway(test)


def test_silent_connections_of_many_addresses_leave_room_for_requests(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service, limits=Limits(of_address=20, total=50)) as address:
            url = urlsplit(address)
            connections = [
                await asyncio.open_connection(url.hostname, url.port, local_addr=(f"127.0.1.{number}", 0))
                for number in range(1, 100)
            ]
            assert (await curl(address, "/api/health"))[0] == 200
            for _, writer in connections:
                writer.close()

    in_gateway(test)


@pytest.mark.parametrize(
    "begin",
    [
        pytest.param(BODY, id="body that does not arrive"),
        pytest.param(GET.format("/openapi.json", "").encode() * 50, id="answers that are not read"),
        pytest.param(GET.format("/api/health", "").encode(), id="answered"),
        pytest.param(GET.format("/api/state", "guess").encode(), id="refused"),
        pytest.param(GET.format("/api/state", TOKENS["operate"]).encode(), id="idle after an answer"),
    ],
)
def test_connections_without_a_request_of_a_known_user_leave_room(in_gateway: Run, begin: bytes) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service, limits=Limits(of_address=20)) as address, opened(address, 20, begin):
            async with asyncio.timeout(30.0):
                while (await curl(address, "/api/state", token=TOKENS["view"]))[0] != 200:
                    pass  # their requests are still being read or answered
            for _ in range(30):
                assert (await curl(address, "/api/state", token=TOKENS["view"]))[0] == 200

    in_gateway(test)


def test_streams_of_known_users_are_not_closed_for_others(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        begin = GET.format("/api/events", TOKENS["view"]).encode()
        async with served(gateway.service, limits=Limits(of_address=20)) as address, opened(address, 20, begin) as them:
            for reader, _ in them:
                assert b" 200 " in await reader.readline()
            ((reader, _),) = await silent(address, 1)
            assert await asyncio.wait_for(reader.read(), 10.0) == b"", "one more of the address is refused"
            assert (await curl(address, "/api/health", "--interface", "127.0.0.2"))[0] == 200
            gateway.events.publish("cell", {})
            for reader, _ in them:
                await asyncio.wait_for(reader.readuntil(b"event: cell"), 10.0)

    in_gateway(test)


@pytest.mark.parametrize("begin", [b"", b"GET /api/hea", b"GET /api/health HTTP/1.1\r\nHost: a\r\n\r\nGET /api"])
def test_connection_without_the_head_of_a_request_is_closed(in_gateway: Run, begin: bytes) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service, limits=Limits(head=0.2)) as address:
            ((reader, writer),) = await silent(address, 1)
            writer.write(begin)
            assert begin.startswith(await asyncio.wait_for(reader.read(), 10.0)) or begin.count(b"GET") == 2
            writer.close()

    in_gateway(test)


def test_body_that_does_not_arrive_is_refused(in_gateway: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(body_limit, "TIMEOUT", 0.2)

    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            ((reader, writer),) = await silent(address, 1)
            head = BODY.replace(b"Host: a\r\n", f"Host: a\r\nAuthorization: Bearer {TOKENS['operate']}\r\n".encode())
            assert b" 408 " in await answered(writer, reader, head)
            writer.close()

    in_gateway(test)


def test_deadline_of_a_request_is_not_that_of_the_next_on_its_connection(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            stop = GET.format("/api/robots/stop", TOKENS["operate"]).replace("GET", "POST")
            stop = stop.replace("\r\n\r\n", "\r\nContent-Type: application/json\r\nContent-Length: 2\r\n\r\n{}")
            first = stop.replace("Host: a", f"Host: a\r\nX-Deadline: {time.monotonic() + 0.3:.3f}")
            async with opened(address, 1, (first + stop).encode()) as ((reader, writer),):  # the second is pipelined
                await asyncio.sleep(0.4)
                writer.write(stop.encode())
                heads = []
                for _ in range(3):
                    heads.append(await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 10.0))
                    await reader.readexactly(int(heads[-1].lower().partition(b"content-length:")[2].split()[0]))
                assert all(b" 200 " in head.splitlines()[0] for head in heads[1:])

    in_gateway(test)


@pytest.mark.parametrize(
    "text", [b"no request\r\n\r\n", b"GET / HTTP/1.1\r\nHost: a\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\r\n"]
)
def test_strange_requests_do_not_fill_the_log(in_gateway: Run, caplog: pytest.LogCaptureFixture, text: bytes) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            for _ in range(20):
                async with opened(address, 1, text) as ((reader, _),):
                    assert await asyncio.wait_for(reader.readline(), 10.0)

    caplog.set_level(logging.INFO)
    in_gateway(test)
    assert len(caplog.records) < 5
