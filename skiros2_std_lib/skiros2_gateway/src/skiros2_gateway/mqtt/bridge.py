"""MQTT: jobs in, states and responses out.

Topics below the prefix (`skiros2` by default):

- `job/in/METHOD`: a command as JSON, signed as in `skiros2_gateway.mqtt.signature`: {order, comment} for store,
  store_and_start and update, {id, comment} for start, revoke_start, pause, resume, stop, abort, cancel and clear.
  `request`, if given, is repeated in the answer; a command with the same `key` (a text) is carried out once. A retained
  command is refused: a broker would send it again after each connection.
- `job/answer`: {request, id, ok} and `job` (its state), or `error` (the problem details as of REST).
- `job/ID/state`, retained: {state, substate, changed}; `job/ID/response`, retained: the complete response. Both are
  removed when the job is cleared. After each connection those of all jobs in the list are published again, also of jobs
  that have ended, and those of jobs that are gone are removed. A job with the id `in` has the topics `job/%69n/...`.
- `cell`, retained: robots, and the first 100 jobs of the queue. `world/ID`, retained: an element of the world model;
  removed with the element.
  `%`, `#`, `+`, `/` and control characters of an id are written as in URLs: `%23`.
- `status`, retained: `online`; `offline` as the last will.

Commands need the role operate. With the setting `mqtt_tokens` a command may instead be {token, ...} without a
signature: all who may read the topic read the token.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import logging
import re
import socket
import ssl
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion

from skiros2_common.core.errors import ConfigurationError, SkirosError, UnknownName
from skiros2_common.core.json_data import read_json
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.element_changes import ElementChanges
from skiros2_gateway.core.events import Event
from skiros2_gateway.core.job import Method
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.keys import Keep, keep_of
from skiros2_gateway.core.problems import Problem, Rejected, Unauthenticated
from skiros2_gateway.core.service import Service
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.mqtt.retained import RetainedJobs
from skiros2_gateway.mqtt.signature import Freshness, signature_of

log = logging.getLogger(__name__)

#: Delivered at least once; commands are idempotent by the job id.
_QOS = 1
_MAX_QUEUED = 10_000
#: The jobs in the topic `cell`.
_QUEUE = 100
#: The pause after an internal error (s).
_PAUSE = 1.0
#: Characters of an id that would change the meaning of a topic, or that MQTT forbids.
_NOT_IN_TOPICS = re.compile(r"[%#+/\x00-\x1f\x7f-\x9f\ud800-\udfff]")
_ORDERS = {"store": Method.STORE, "store_and_start": Method.STORE_AND_START, "update": Method.UPDATE}
#: The retained topics of a job.
_KINDS = ("state", "response")
#: The fields of a command that say what is done.
_FIELDS = ("id", "order", "comment")
_METHODS = {m.name.lower(): m for m in Method if m.name.lower() not in _ORDERS}


class MqttBridge:
    """The client of a broker. To be used in the gateway's loop; paho's thread hands over to it.

    It connects, and connects again, in the background.
    """

    def __init__(self, service: Service, settings: Settings) -> None:
        """
        :raises ConfigurationError: a file of the settings cannot be read, or the port is not a number.
        :raises StoreFailed: the used signatures cannot be read.
        """
        self._service = service
        self._prefix = settings.mqtt_prefix.strip("/")
        self._max_body = settings.max_body
        self._takes_tokens = settings.mqtt_tokens
        self._freshness = Freshness(service.store)
        self._loop = asyncio.get_running_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._changes = ElementChanges(service.control.cell.document)
        self._jobs = RetainedJobs(service, self._publish)
        self._all_jobs: asyncio.Task[None] | None = None  # publishes all jobs
        host, _, port = settings.mqtt.partition(":")
        if port and not port.isdigit():
            raise ConfigurationError(f"mqtt {settings.mqtt!r}, expected HOST or HOST:PORT")
        self._client = paho.Client(CallbackAPIVersion.VERSION2, client_id="", protocol=paho.MQTTv311)
        self._client.max_queued_messages_set(_MAX_QUEUED)
        self._client.will_set(self._topic("status"), "offline", _QOS, retain=True)
        try:
            if settings.mqtt_user:
                file = Path(settings.mqtt_password_file).expanduser()
                self._client.username_pw_set(settings.mqtt_user, file.read_text().strip())
            if settings.mqtt_ca:
                self._client.tls_set(settings.mqtt_ca, tls_version=ssl.PROTOCOL_TLS_CLIENT)
        except (OSError, ValueError, ssl.SSLError) as error:
            raise ConfigurationError(f"mqtt: {error}") from error
        self._client.on_socket_open = lambda _, __, sock: without_delay(sock)
        self._client.on_connect = lambda _, __, ___, reason, ____: self._in_loop(self._on_connect, reason)
        self._client.on_message = lambda _, __, message: self._in_loop(self._on_message, message)
        self._address = (host, int(port) if port else (8883 if settings.mqtt_ca else 1883))

    def start(self) -> None:
        """Starts to connect."""
        self._client.reconnect_delay_set(1, 5)
        self._client.connect_async(*self._address, keepalive=10)
        self._client.loop_start()
        self._spawn(self._follow())
        self._spawn(self._follow_elements())

    async def stop(self) -> None:
        """Says `offline` and disconnects."""
        for task in self._tasks:
            task.cancel()
        farewell = self._client.publish(self._topic("status"), "offline", _QOS, retain=True)
        if self._client.is_connected():
            await asyncio.to_thread(farewell.wait_for_publish, 1.0)
        self._client.disconnect()
        await asyncio.to_thread(self._client.loop_stop)

    # -- in ----------------------------------------------------------------------------------------------------

    def _on_connect(self, reason: Any) -> None:
        if reason.is_failure:
            log.error("the MQTT broker %s:%d refuses the gateway: %s", *self._address, reason)
            return
        log.info("connected to the MQTT broker %s:%d", *self._address)
        self._client.subscribe(self._topic("job/in/+"), _QOS)
        self._client.subscribe([(self._topic(f"job/+/{kind}"), 0) for kind in _KINDS])
        self._publish("status", "online")
        self._publish_all()

    def _on_message(self, message: paho.MQTTMessage) -> None:
        group, name = message.topic.split("/")[-2:]
        if group == "in":
            self._spawn(self._command(name, message.payload, message.retain))
        elif message.retain:
            self._jobs.check(group, name)

    async def _command(self, method: str, payload: bytes, is_retained: bool) -> None:
        data: dict[str, Any] = {}
        try:
            message = self._read(payload, is_retained)
            data = _json_object(str(message["command"])) if "command" in message else message
            caller = self._authenticate(method, message, data)
            key, wanted = str(data.get("key", "")), [method, *(data.get(field) for field in _FIELDS)]
            work = partial(self._apply, caller, method, data)
            keep = keep_of(method)
            if keep is Keep.BEFORE:
                await self._freshness.write()
            answer: dict[str, Any] = await self._service.once(caller, key, wanted, work, keep)
        except SkirosError as error:
            problems = [each.to_dict() for each in error.problems] if isinstance(error, Rejected) else []
            answer = {"ok": False, "error": {"code": error.code, "detail": str(error), "problems": problems}}
        finally:
            await self._freshness.write()
        self._publish("job/answer", {"request": data.get("request", ""), **answer}, retain=False)

    def _read(self, payload: bytes, is_retained: bool) -> dict[str, Any]:
        """
        :raises Rejected: the message is not a command.
        """
        if len(payload) > self._max_body:
            raise Rejected([Problem("wrong_type", "", f"expected at most {self._max_body} bytes")])
        data = _json_object(payload)
        if is_retained:
            raise Rejected([Problem("wrong_value", "", "the command is retained", "a command that is not retained")])
        return data

    def _authenticate(self, method: str, message: dict[str, Any], data: dict[str, Any]) -> Caller:
        """
        :param data: the fields of the command in the message.
        """
        access = self._service.access
        if "signature" not in message and self._takes_tokens:
            return access.authenticate(str(message.get("token", "")), "mqtt", "mqtt")
        if "token" in message:
            text = "tokens in messages are refused, as all readers of the topic have read this one: sign the command"
            raise Unauthenticated(text)
        name, command, signature = (str(message.get(key, "")) for key in ("user", "command", "signature"))

        def is_right(key: str) -> bool:
            found = signature.encode("utf-8", "replace")
            return hmac.compare_digest(signature_of(key, method, command).encode(), found)

        caller = access.authenticate_signature(name, is_right, "mqtt", "mqtt")
        self._freshness.check(signature, data.get("time"))
        return caller

    async def _apply(self, caller: Caller, method: str, data: dict[str, Any]) -> dict[str, Any]:
        """Carries out a command. Returns its answer."""
        comment = str(data.get("comment", ""))
        if method == "update":
            job = await self._service.update(caller, data.get("order"), comment)
        elif method in _ORDERS:
            start = _ORDERS[method] is Method.STORE_AND_START
            job, _ = await self._service.put(caller, data.get("order"), comment, start=start)
        elif method in _METHODS:
            job = await self._service.apply(caller, _METHODS[method], str(data.get("id", "")), comment)
        else:
            raise UnknownName(f"there is no method {method!r}; there are: {', '.join([*_ORDERS, *_METHODS])}")
        return {"ok": True, "job": {"state": job.state, "substate": job.substate}, "id": job.id}

    # -- out ---------------------------------------------------------------------------------------------------

    async def _follow(self) -> None:
        after = ""
        while True:
            try:
                if after:  # events were missed
                    self._publish_all()
                async for event in self._service.events.follow(after):
                    if event.kind == "reset":
                        self._publish_all()
                    else:
                        self._guarded(event)
            except Exception:
                log.exception("MQTT: all is published again in %g s", _PAUSE)
            after = self._service.events.last_id
            await asyncio.sleep(_PAUSE)

    def _guarded(self, event: Event) -> None:
        """Publishes an event. One with a mistake does not cost the others."""
        try:
            self._on_event(event)
        except Exception:
            log.exception("MQTT: the event %s of kind %s is not published", event.id, event.kind)

    def _on_event(self, event: Event) -> None:
        data = event.data
        if event.kind == "job":
            self._jobs.publish_state(data)
        elif event.kind == "response":
            self._jobs.publish_response(data["job"], data)
        elif event.kind == "cell":
            self._publish_cell()

    async def _follow_elements(self) -> None:
        while True:
            self._publish_elements(await self._changes.take())

    def _publish_elements(self, elements: Mapping[str, Any]) -> None:
        """
        :param elements: by id; None removes what is retained. One with a mistake does not cost the others.
        """
        for eid, element in elements.items():
            try:
                self._publish(f"world/{topic_part(eid)}", element)
            except Exception:
                log.exception("MQTT: the element %s is not published", eid)

    def _publish_all(self) -> None:
        """Publishes the state, after a connection or where events are missing."""
        self._publish_cell()
        self._publish_elements(self._changes.all())
        if self._all_jobs is not None:
            self._all_jobs.cancel()
        self._all_jobs = self._spawn(self._publish_jobs())

    async def _publish_jobs(self) -> None:
        """Publishes all jobs; then what is retained of jobs needs no check any more."""
        await self._jobs.publish_all()
        self._client.unsubscribe([self._topic(f"job/+/{kind}") for kind in _KINDS])

    def _publish_cell(self) -> None:
        queue = [{"id": job.id, "state": job.state.value} for job in self._service.control.jobs.ordered(_QUEUE)]
        self._publish("cell", {**self._service.control.cell.state(), "queue": queue})

    def _publish(self, topic: str, data: Any, *, retain: bool = True) -> paho.MQTTMessageInfo | None:
        """Publishes JSON data or text; None removes what is retained. Returns None if the topic is impossible."""
        payload = data if isinstance(data, str) else b"" if data is None else json_text(data)
        try:
            return self._client.publish(self._topic(topic), payload, _QOS, retain)
        except ValueError as error:  # such as a topic that is too long: the others are published
            log.error("MQTT topic %.200s: %s", topic, error)
            return None

    # -- internals ---------------------------------------------------------------------------------------------

    def _topic(self, name: str) -> str:
        return f"{self._prefix}/{name}"

    def _in_loop(self, call: Callable[..., Any], *arguments: Any) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(call, *arguments)

    def _spawn(self, work: Any) -> asyncio.Task[None]:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._on_done)
        return task

    def _on_done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("MQTT: an internal error", exc_info=error)


def topic_part(name: str) -> str:
    """Returns a name as one level of a topic."""
    return _NOT_IN_TOPICS.sub(lambda found: "".join(f"%{byte:02X}" for byte in _bytes(found[0])), name)


def _bytes(character: str) -> bytes:
    return character.encode("utf-8", "surrogatepass")


def _json_object(text: str | bytes) -> dict[str, Any]:
    """
    :raises Rejected: it is not a JSON object.
    """
    try:
        data = read_json(text if isinstance(text, str) else text.decode())
        json.dumps(data, ensure_ascii=False).encode()  # an escaped half of a surrogate pair is not text
    except (ValueError, RecursionError) as error:
        raise Rejected([Problem("wrong_value", "", f"the message is not JSON: {error}")]) from None
    if not isinstance(data, dict):
        raise Rejected([Problem("wrong_type", "", "the message is not a JSON object")])
    return data


def without_delay(sock: socket.socket) -> None:
    """Has small messages sent at once: otherwise each waits up to 44 ms for an acknowledgement (Nagle's algorithm)."""
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
