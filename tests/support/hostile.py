"""Hostile requests for the gateway, from a seed: REST, MQTT and OPC UA."""

from __future__ import annotations

import asyncio
import itertools
import json
import string
from collections import Counter
from collections.abc import Mapping
from random import Random
from typing import Any
from urllib.parse import quote, urlsplit

import paho.mqtt.client as paho
from asyncua import Client, ua
from paho.mqtt.enums import CallbackAPIVersion

from skiros2_gateway.core.job import Method
from skiros2_gateway.mqtt.bridge import without_delay
from skiros2_gateway.mqtt.signature import sign
from support.opcua import cell_index

#: The ids of valid orders that are sent without the role: no such job may exist.
FORBIDDEN = "forbidden"

_TEXTS = (
    "", " ", "\0", "\r\nX: y", "../../etc/passwd", "'; DROP TABLE jobs; --", "{Tray}", "(", ")" * 50, "(" * 500,
    "(at robot home)", "(skiros:contain ?x ?y)", "SELECT ?s WHERE {?s ?p ?o}", "INSERT DATA { <a:b> <a:b> <a:b> }",
    "\N{PILE OF POO}", "\ud800", "نص", "%00%2e%2e", "<script>alert(1)</script>", "null", "NaN", "1e999", "x" * 3000,
    "/porter", "Tray-1", "a", "skiros:Scene-0",
)  # fmt: skip
_NUMBERS = (0, -1, 1, 2**31, -(2**63), 2**70, 10**300, 1e308, -0.0, 0.1, float("inf"), float("nan"))
_FIELDS = ("id", "goal", "work_master", "parameters", "priority", "earliest_start", "due", "robots", "quality", "start")
_METHODS = [method.name.lower() for method in Method]
_PATHS = (
    "/api/jobs", "/api/jobs/{}", "/api/jobs/{}/{}", "/api/jobs/{}/history", "/api/state", "/api/world", "/api/skills",
    "/api/work_masters", "/api/robots/{}", "/api/audit", "/api/session", "/api/health", "/api/jobs?state={}&limit={}",
    "/api/world/query", "/{}", "/api/{}",
)  # fmt: skip
#: Requests that command, with the role operate.
_COMMANDS = (("POST", "/api/jobs"), ("POST", "/api/robots/stop"), ("PUT", "/api/jobs/a"), ("POST", "/api/jobs/a/abort"))


class Hostile:
    """Makes hostile data."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self._numbers = itertools.count()

    def text(self) -> str:
        if self.random.random() < 0.8:
            return self.random.choice(_TEXTS)
        return "".join(self.random.choices(string.printable, k=self.random.randrange(40)))

    def value(self, depth: int = 0) -> Any:
        kind = self.random.randrange(8 if depth < 3 else 4)
        if kind < 2:
            return self.text()
        if kind == 2:
            return self.random.choice(_NUMBERS)
        if kind == 3:
            return self.random.choice((None, True, False))
        if kind < 6:
            return [self.value(depth + 1) for _ in range(self.random.randrange(4))]
        return {self.text(): self.value(depth + 1) for _ in range(self.random.randrange(4))}

    def order(self) -> Any:
        """An order in which something is wrong, mostly."""
        order: dict[str, Any] = {"id": f"hostile-{next(self._numbers)}", "goal": "(at robot home)"}
        for _ in range(self.random.randrange(1, 4)):
            order[self.random.choice((*_FIELDS, self.text()))] = self.value()
        return order if self.random.random() < 0.9 else self.value()

    def forbidden_order(self) -> dict[str, Any]:
        """A valid order, to be sent without the role."""
        return {"id": f"{FORBIDDEN}-{next(self._numbers)}", "goal": "(at robot home)"}

    def json(self, value: Any) -> bytes:
        """JSON, sometimes broken."""
        data = json.dumps(value).encode()
        kind = self.random.random()
        if kind < 0.05:
            return data[: self.random.randrange(len(data) + 1)]
        if kind < 0.08:
            return self.random.randbytes(self.random.randrange(200))
        if kind < 0.1:
            return b"[" * 5000
        return data


# -- REST --------------------------------------------------------------------------------------------------------------


async def fuzz_rest(address: str, tokens: Mapping[str, str], hostile: Hostile, count: int) -> Counter[int]:
    """Sends requests on kept connections. Returns the number of answers by status; 0: the connection was closed.

    :raises AssertionError: a request without the role is carried out, or the server fails.
    """
    url, random, found = urlsplit(address), hostile.random, Counter[int]()
    reader = writer = None
    for _ in range(count):
        token = random.choice(("", "guess", tokens["view"], tokens["operate"], tokens["operate"]))
        may_command = token == tokens["operate"]
        if may_command or random.random() < 0.5:
            method = random.choice(("GET", "POST", "PUT", "DELETE", "PATCH", "OPTIONS"))
            path = random.choice(_PATHS).replace("{}", "%s")
            path %= tuple(quote(hostile.text(), errors="replace") or "x" for _ in range(path.count("%s")))
            body = hostile.json(hostile.order() if random.random() < 0.7 else hostile.value())
        else:
            (method, path), body = random.choice(_COMMANDS), json.dumps(hostile.forbidden_order()).encode()
            body = {"/api/robots/stop": b'{"robots": []}', "/api/jobs/a/abort": b"{}"}.get(path, body)
        head = f"{method} {path} HTTP/1.1\r\nHost: {url.netloc}\r\nContent-Type: application/json\r\n"
        head += f"Authorization: Bearer {token}\r\nContent-Length: {len(body)}\r\n"
        if random.random() < 0.02:
            head += f"{hostile.text()}: {hostile.text()}\r\n"
        if writer is None:
            reader, writer = await asyncio.open_connection(url.hostname, url.port)
        writer.write(head.encode("utf-8", "replace") + b"\r\n" + body)
        status = await _status(reader)
        found[status] += 1
        assert status < 500, f"{status}: {head}{body[:500]!r}"
        is_command = (method, path) in _COMMANDS
        assert may_command or not is_command or status == 0 or status >= 400, f"{status}: {head}{body[:500]!r}"
        if status in (0, 400, 413):  # the server closes the connection
            writer.close()
            writer = None
    if writer is not None:
        writer.close()
    return found


async def _status(reader: Any) -> int:
    """Reads an answer; 0 if the connection was closed."""
    try:
        head = (await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 30.0)).decode("latin-1").lower()
        length = int(head.partition("content-length:")[2].partition("\r\n")[0] or 0)
        await reader.readexactly(length)
    except (asyncio.IncompleteReadError, ConnectionError):
        return 0
    return int(head.split()[1])


# -- MQTT --------------------------------------------------------------------------------------------------------------


async def fuzz_mqtt(port: int, prefix: str, tokens: Mapping[str, str], hostile: Hostile, count: int) -> Counter[str]:
    """Publishes commands. Returns the number of answers by error code; "ok" for those that are carried out.

    :raises AssertionError: a command without the role is carried out.
    """
    loop, random, found = asyncio.get_running_loop(), hostile.random, Counter[str]()
    answers: asyncio.Queue[Any] = asyncio.Queue()
    is_online = asyncio.Event()
    client = paho.Client(CallbackAPIVersion.VERSION2)

    def on_message(_: Any, __: Any, message: paho.MQTTMessage) -> None:
        if message.topic.endswith("/status"):
            loop.call_soon_threadsafe(is_online.set)
        else:
            loop.call_soon_threadsafe(answers.put_nowait, json.loads(message.payload))

    client.on_socket_open = lambda _, __, sock: without_delay(sock)
    client.on_message = on_message
    client.connect("127.0.0.1", port)
    client.subscribe([(f"{prefix}/job/answer", 1), (f"{prefix}/status", 1)])
    client.loop_start()
    await asyncio.wait_for(is_online.wait(), 30.0)
    allowed = set()
    for number in range(count):
        command: dict[str, Any] = {"request": number, "order": hostile.order(), "id": hostile.text()}
        user = random.choice(("", "guess", "view", "operate", "operate"))
        may_command = user == "operate"
        if not may_command and random.random() < 0.5:
            command["order"] = hostile.forbidden_order()
        if random.random() < 0.2:
            command[random.choice(("time", "comment", "order", "x"))] = hostile.value()
        method = random.choice((*_METHODS, "store_and_start", "x" * 100))
        message = json.loads(sign(user, tokens.get(user, "guess"), method, command))
        if random.random() < 0.2:
            may_command = False
            key = random.choice(("user", "command", "signature", "token"))
            message[key] = hostile.value() if random.random() < 0.5 else hostile.text()
            if key == "token":
                del message["signature"]
        if may_command:
            allowed.add(number)
        client.publish(f"{prefix}/job/in/{method}", hostile.json(message), 1)
        answer = await asyncio.wait_for(answers.get(), 60.0)
        assert not answer["ok"] or answer["request"] in allowed, f"{method} {command}: {answer}"
        found["ok" if answer["ok"] else answer["error"]["code"]] += 1
    client.disconnect()
    await asyncio.to_thread(client.loop_stop)
    return found


# -- OPC UA ------------------------------------------------------------------------------------------------------------

_VARIANTS = (
    ua.VariantType.String, ua.VariantType.Int32, ua.VariantType.Boolean, ua.VariantType.Double,
    ua.VariantType.ByteString, ua.VariantType.LocalizedText, ua.VariantType.NodeId, ua.VariantType.Null,
)  # fmt: skip


async def fuzz_opcua(client: Client, index: int, hostile: Hostile, count: int) -> Counter[str]:
    """Calls methods with hostile arguments, and writes nodes. Returns the number of answers by status.

    :param client: connected, with the types loaded.
    :raises AssertionError: a call has failed within the server.
    """
    random, found = hostile.random, Counter[str]()
    cell = await cell_index(client)
    names = [method.value for method in Method]
    names += ["RequestJobResponseByJobOrderID", "RequestJobResponseByJobOrderState"]
    for _ in range(count):
        name = random.choice(names)
        of = "JobResponseProvider" if name.startswith("Request") else "JobOrderReceiver"
        place = client.get_node(ua.NodeId(of, cell))
        arguments = [_argument(hostile) for _ in range(random.choice((0, 1, 2, 2, 2, 3)))]
        if random.random() < 0.6:
            arguments = _fitting(hostile, name)
        try:
            if random.random() < 0.05:
                await place.write_value(arguments[0] if arguments else ua.Variant(1))
            else:
                await place.call_method(f"{index}:{name}", *arguments)
            found["done"] += 1
        except ua.UaStatusCodeError as error:
            status = ua.status_codes.get_name_and_doc(error.code)[0]
            assert status not in ("BadUnexpectedError", "BadInternalError"), f"{name} {arguments}: {error}"
            found[status] += 1
    return found


def _fitting(hostile: Hostile, method: str) -> list[ua.Variant]:
    """Hostile arguments of the declared types."""
    random = hostile.random
    if method.endswith("ByJobOrderState"):
        states = [
            ua.ISA95StateDataType(StateText=ua.LocalizedText(_plain(hostile.text())), StateNumber=random.randrange(9))
            for _ in range(random.randrange(4))
        ]
        return [ua.Variant(states, ua.VariantType.ExtensionObject, is_array=True)]
    first = _order(hostile) if method in ("Store", "StoreAndStart", "Update") else ua.Variant(_plain(hostile.text()))
    comment = ua.Variant([], ua.VariantType.LocalizedText, is_array=True)
    return [first] if method.startswith("Request") else [first, comment]


def _order(hostile: Hostile) -> ua.Variant:
    random = hostile.random
    order = ua.ISA95JobOrderDataType(JobOrderID=_plain(hostile.text()), Priority=random.choice((0, 32767, -32768)))
    order.JobOrderParameters = [
        ua.ISA95ParameterDataType(ID=_plain(hostile.text()), Value=_simple(hostile)) for _ in range(random.randrange(4))
    ]
    if random.random() < 0.5:
        order.WorkMasterID = [ua.ISA95WorkMasterDataType(ID=_plain(hostile.text()))] * random.randrange(3)
    return ua.Variant(order)


def _argument(hostile: Hostile) -> ua.Variant:
    return _order(hostile) if hostile.random.random() < 0.4 else _simple(hostile)


def _simple(hostile: Hostile) -> ua.Variant:
    kind = hostile.random.choice(_VARIANTS)
    values: dict[Any, Any] = {
        ua.VariantType.String: _plain(hostile.text()), ua.VariantType.Int32: hostile.random.randrange(-5, 2**31),
        ua.VariantType.Boolean: True, ua.VariantType.Double: hostile.random.choice((1e308, float("nan"), 0.0)),
        ua.VariantType.ByteString: hostile.random.randbytes(20), ua.VariantType.LocalizedText: ua.LocalizedText("x"),
        ua.VariantType.NodeId: ua.NodeId(5, 9), ua.VariantType.Null: None,
    }  # fmt: skip
    if kind is not ua.VariantType.Null and hostile.random.random() < 0.2:
        return ua.Variant([values[kind]] * hostile.random.randrange(3), kind, is_array=True)
    return ua.Variant(values[kind], kind)


def _plain(text: str) -> str:
    """What UTF-8 can carry."""
    return text.encode("utf-8", "replace").decode()
