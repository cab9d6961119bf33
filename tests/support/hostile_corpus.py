"""Hostile inputs by interface, each kept because it has broken something, or might. Add what breaks something new."""

from __future__ import annotations

import json
from typing import Any

_JSON = b"Content-Type: application/json\r\n"


def _request(line: str, headers: bytes = b"", body: bytes = b"", length: str = "") -> bytes:
    size = length or str(len(body))
    return f"{line} HTTP/1.1\r\nHost: a\r\nContent-Length: {size}\r\n".encode() + headers + b"\r\n" + body


def _order(fields: str) -> bytes:
    return b'{"id": "a", "goal": "(at robot home)"' + fields.encode("utf-8", "surrogatepass") + b"}"


#: What is sent on a connection. `TOKEN` is replaced by that of a user with the role operate.
HTTP = {
    "nothing": b"",
    "no text": bytes(range(256)),
    "TLS where none is expected": b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\0" * 64,
    "line without end": b"GET /" + b"a" * 100_000,
    "headers without end": b"GET /api/health HTTP/1.1\r\n" + b"X: y\r\n" * 20_000,
    "two lengths": b"POST /api/jobs HTTP/1.1\r\nHost: a\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n{}",
    "length and chunks": _request("POST /api/jobs", b"Transfer-Encoding: chunked\r\n", b"0\r\n\r\nGET /x\r\n\r\n"),
    "negative length": _request("POST /api/jobs", length="-1"),
    "huge length": _request("POST /api/jobs", b"Authorization: Bearer TOKEN\r\n", length="9" * 30),
    "no method": b" / HTTP/1.1\r\n\r\n",
    "WebSocket": _request("GET /api/events", b"Connection: Upgrade\r\nUpgrade: websocket\r\n"),
    "number beyond the store": _request("GET /api/jobs?since=99999999999999999999", b"Authorization: Bearer TOKEN\r\n"),
    "number of 5000 digits": _request(f"GET /api/audit?since={'9' * 5000}", b"Authorization: Bearer TOKEN\r\n"),
    "time that is not a number": _request("GET /api/live/runs/x?time=nan", b"Authorization: Bearer TOKEN\r\n"),
    "strange event": _request("GET /api/nothing?after=x-%C2%B2", b"Authorization: Bearer TOKEN\r\n"),
    "token that is not text": _request("GET /api/state", b"Authorization: Bearer \xff\xfe\x00\r\n"),
    "cookies": _request("GET /api/state", b"Cookie: " + b"skiros2_gateway=x; " * 500 + b"\r\n"),
    "path above the root": _request("GET /page/../../../../etc/passwd"),
    "path with codes": _request("GET /page/%2e%2e%2f%2e%2e%2fetc%2fpasswd%00.js"),
    **{
        f"body: {name}": _request("POST /api/jobs", _JSON + b"Authorization: Bearer TOKEN\r\n", body)
        for name, body in {
            "NaN": _order(', "priority": NaN'),
            "infinity": _order(', "work_master": "place", "parameters": {"Speed": Infinity}'),
            "40 digits": _order(f', "parameters": {{"x": {10**40}}}'),
            "5000 digits": _order(f', "priority": {"9" * 5000}'),
            "deep": b"[" * 100_000,
            "half a surrogate pair": _order(', "description": "\\ud800"'),
            "no UTF-8": b'{"id": "\xff"}',
            "UTF-16": '{"id": "a"}'.encode("utf-16"),
            "prototype": _order(', "__proto__": {"role": "maintain"}'),
            "far time": _order(', "due": "9999-12-31T23:59:59Z", "earliest_start": "0001-01-01T00:00:00Z"'),
        }.items()
    },
}

#: Payloads of commands.
MQTT: dict[str, bytes] = {
    "nothing": b"",
    "no text": bytes(range(256)),
    "list": b"[]",
    "deep": b"[" * 100_000,
    "NaN": b'{"user": "operate", "command": "NaN", "signature": "x"}',
    "command that is an object": b'{"user": "operate", "command": {"a": 1}, "signature": "x"}',
    "signature that is a list": b'{"user": "operate", "command": "{}", "signature": [1]}',
    "signature with umlauts": '{"user": "operate", "command": "{}", "signature": "ä"}'.encode(),
    "half a surrogate pair": b'{"user": "\\ud800", "command": "\\ud800", "signature": "\\ud800"}',
    "no user": b'{"command": "{}", "signature": ""}',
    "token": b'{"token": "x"}',
    "5000 digits": b'{"user": ' + b"9" * 5000 + b"}",
}

#: Ids of elements, as some world model may have them.
IDS = ("#", "+", "a/b", "/", "$SYS/x", "", " ", "\0", "\ud800", "x" * 70_000, "%23", "..", "\n", "__proto__", "<b>")

#: What is sent on a connection of OPC UA.
OPCUA: dict[str, bytes] = {
    "nothing": b"",
    "HTTP": b"GET / HTTP/1.1\r\n\r\n",
    "no text": bytes(range(256)),
    "hello with a huge length": b"HELF\xff\xff\xff\xff" + b"\0" * 1000,
    "hello with no length": b"HELF\0\0\0\0",
    "hello with huge limits": b"HELF\x20\0\0\0" + b"\xff" * 20 + b"\xff\xff\xff\x7f",
    "channel before hello": b"OPNF\x20\0\0\0\0\0\0\0" + b"\xff" * 20,
    "message without channel": b"MSGF\x20\0\0\0\x01\0\0\0" + b"\0" * 20,
    "chunks without end": (b"HELF\x20\0\0\0" + b"\0" * 24) + b"MSGC\x20\0\0\0\x01\0\0\0" + b"\0" * 20,
}

#: Definitions of work masters as YAML.
WORK_MASTERS = (
    "{goal: '({P:>200000000})', parameters: [{id: P, type: string}]}",
    "{goal: '({P!r})', parameters: [{id: P, type: string}]}",
    "{goal: '({P.__class__})', parameters: [{id: P, type: string}]}",
    "{goal: '({0})', parameters: [{id: P, type: string}]}",
    "{goal: '({', parameters: []}",
    "{goal: x, parameters: [{id: P, type: number, maximum: .nan}]}",
    "{goal: x, parameters: [{id: P, type: number, default: .inf}]}",
    f"{{goal: x, parameters: [{{id: P, type: integer, default: {10**40}}}]}}",
    "!!python/object/apply:os.system ['false']",
    "[" * 2000,
    "&a [*a]",
)

#: Values in the world model that interfaces show.
VALUES: tuple[Any, ...] = (float("nan"), float("inf"), 10**400, -(10**40), "\0", "\ud800", json.dumps([1]), b"\xff")
