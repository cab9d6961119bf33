"""Hostile requests of agents: the protocol's messages and the arguments of tools, over HTTP."""

from __future__ import annotations

import asyncio
import json
from collections import Counter
from collections.abc import Callable, Collection, Mapping
from typing import Any
from urllib.parse import urlsplit

from support.hostile import Hostile

#: Values that are right for some arguments.
_GOOD = ("a", "(at robot home)", "place", "/robot", "Tray-1", 0, True, {}, [], "", 1)
_METHODS = ("tools/list", "initialize", "ping", "resources/list", "notifications/cancelled", "x" * 100)


async def fuzz_agents(
    address: str,
    tokens: Mapping[str, str],
    fields: Mapping[str, Collection[str]],
    hostile: Hostile,
    count: int,
    may_not: Callable[[], Any],
) -> Counter[str]:
    """Sends messages on kept connections. Returns the number of answers by status, and of tools by error code.

    :param fields: the names of the arguments by tool.
    :param may_not: returns what only the roles `agent` and `operate` may change.
    :raises AssertionError: the server fails, or changes something without the role.
    """
    url, random, found = urlsplit(address), hostile.random, Counter[str]()
    reader = writer = None
    for number in range(count):
        user = random.choice(("", "guess", "view", "agent", "agent", "operate"))
        before = may_not()
        message = _call(hostile, fields, number) if random.random() < 0.8 else _message(hostile, number)
        body = hostile.json(message)
        accept = "application/json, text/event-stream" if random.random() < 0.98 else hostile.text()
        head = f"POST /mcp HTTP/1.1\r\nHost: {url.netloc}\r\nContent-Type: application/json\r\nAccept: {accept}\r\n"
        head += f"Authorization: Bearer {tokens.get(user, user)}\r\nContent-Length: {len(body)}\r\n"
        if writer is None:
            reader, writer = await asyncio.open_connection(url.hostname, url.port)
        writer.write(head.encode("utf-8", "replace") + b"\r\n" + body)
        status, answer = await _answer(reader)
        found[str(status)] += 1
        assert status < 500, f"{status}: {head}{body[:500]!r}"
        may_call = user in ("agent", "operate")
        assert may_call or may_not() == before, f"{user}: {body[:500]!r}"
        assert user not in ("", "guess") or status in (0, 400, 401, 403, 413, 429), f"{status}: {head}"
        if (result := answer.get("result")) and "content" in result:
            found[result["structuredContent"]["code"] if result["isError"] else "done"] += 1
        if status in (0, 400, 413):  # the server closes the connection, or the rest of the body is not a message
            writer.close()
            writer = None
    if writer is not None:
        writer.close()
    return found


def _call(hostile: Hostile, fields: Mapping[str, Collection[str]], number: int) -> dict[str, Any]:
    random = hostile.random
    name = random.choice([*fields, hostile.text()])
    known = list(fields.get(name, ("job",)))
    chosen = random.sample([*known, "x"], random.randrange(len(known) + 1))
    is_good = random.random() < 0.7
    arguments: Any = {key: random.choice(_GOOD) if is_good else hostile.value(2) for key in chosen}
    if random.random() < 0.05:
        arguments = hostile.value()
    return _request("tools/call", {"name": name, "arguments": arguments}, number)


def _message(hostile: Hostile, number: int) -> Any:
    message = _request(hostile.random.choice(_METHODS), hostile.value(), number)
    if hostile.random.random() < 0.5:
        message[hostile.random.choice(tuple(message))] = hostile.value()
    return message if hostile.random.random() < 0.8 else hostile.value()


def _request(method: str, params: Any, number: int) -> dict[str, Any]:
    return {"jsonrpc": "2.0", "id": number, "method": method, "params": params}


async def _answer(reader: Any) -> tuple[int, dict[str, Any]]:
    """Reads an answer; the status is 0 if the connection was closed."""
    try:
        head = (await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 30.0)).decode("latin-1").lower()
        length = int(head.partition("content-length:")[2].partition("\r\n")[0] or 0)
        body = await reader.readexactly(length)
    except (asyncio.IncompleteReadError, ConnectionError):
        return 0, {}
    data = json.loads(body) if body else {}
    return int(head.split()[1]), data if isinstance(data, dict) else {}
