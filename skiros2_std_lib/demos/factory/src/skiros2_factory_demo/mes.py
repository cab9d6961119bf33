"""A small manufacturing execution system: it sends jobs by REST, OPC UA and MQTT, and gets their responses."""

from __future__ import annotations

import asyncio
import json
import socket
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any, Protocol

import paho.mqtt.client as paho
from asyncua import Client, ua
from paho.mqtt.enums import CallbackAPIVersion

from skiros2_common.core.errors import Refused
from skiros2_gateway.mqtt.signature import sign

#: An order as JSON data: see `POST /api/jobs` in the gateway's OpenAPI description.
Order = dict[str, Any]
#: Of a response: `outcome`, `message`, `started` and `ended` (s since the epoch), `changes`, `quality` (data by name).
Answer = dict[str, Any]

#: The begin of the URI of a cell's namespace in OPC UA, which has its objects.
_CELL_NAMESPACE = "urn:skiros2:cell:"
#: `ReturnStatus` of a method of OPC UA Job Control that was carried out.
_SUCCESS = 1
#: Period of reading a response where no message comes (s).
_PERIOD = 0.5
_TIMEOUT = 60.0  # s, for the answer of a request


class Channel(Protocol):
    """One way to the gateway."""

    async def send(self, order: Order) -> None:
        """Stores an order and starts it.

        :raises Refused: the gateway rejects it; the text has all problems.
        """

    async def response(self, job_id: str) -> Answer:
        """Waits for the complete response of a job."""

    async def close(self) -> None: ...


class RestChannel:
    """REST, with the standard library's client.

    :param address: of the gateway: `http://...`.
    :param token: of a user with the role operate.
    """

    def __init__(self, address: str, token: str) -> None:
        self._address = address
        self._token = token

    async def send(self, order: Order) -> None:
        await asyncio.to_thread(self.request, "POST", "/api/jobs", order)

    async def response(self, job_id: str) -> Answer:
        while True:
            job = await asyncio.to_thread(self.request, "GET", f"/api/jobs/{job_id}")
            if job["response"]["collected"]:
                return dict(job["response"])
            await asyncio.sleep(_PERIOD)

    async def close(self) -> None:
        """Nothing stays open."""

    def request(self, method: str, path: str, body: Any = None) -> Any:
        """Returns the decoded answer of a request.

        :raises Refused: with the detail of the problem.
        """
        data = None if body is None else json.dumps(body).encode()
        headers = {"Authorization": f"Bearer {self._token}", "Content-Type": "application/json"}
        request = urllib.request.Request(self._address + path, data, headers, method=method)
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT) as answer:
                return json.loads(answer.read())
        except urllib.error.HTTPError as error:
            raise Refused(json.loads(error.read())["detail"]) from None


class OpcuaChannel:
    """OPC UA Job Control, with asyncua's client.

    :param index: of the namespace of the types.
    :param cell: of the namespace of the cell's objects.
    """

    def __init__(self, client: Client, index: int, cell: int) -> None:
        self.client = client
        self.index, self.cell = index, cell
        self._nodes: dict[str, Any] = {}

    @classmethod
    async def connect(cls, address: str, user: str, token: str, namespace: str) -> OpcuaChannel:
        """Connects and reads the types of the server.

        :param address: `opc.tcp://...`.
        :param namespace: URI of the types.
        """
        client = Client(address, timeout=_TIMEOUT, watchdog_intervall=_TIMEOUT)
        client.set_user(user)
        client.set_password(token)
        await client.connect()
        await client.load_data_type_definitions()
        namespaces = await client.get_namespace_array()
        [cell] = (index for index, uri in enumerate(namespaces) if uri.startswith(_CELL_NAMESPACE))
        return cls(client, namespaces.index(namespace), cell)

    async def send(self, order: Order) -> None:
        made = ua.ISA95JobOrderDataType(JobOrderID=order["id"], Priority=order.get("priority", 0))
        made.WorkMasterID = [ua.ISA95WorkMasterDataType(ID=order["work_master"])]
        made.JobOrderParameters = [
            ua.ISA95ParameterDataType(ID=key, Value=ua.Variant(value)) for key, value in order["parameters"].items()
        ]
        no_comment = ua.Variant([], ua.VariantType.LocalizedText, is_array=True)
        status = await self._call("JobOrderReceiver", "StoreAndStart", made, no_comment)
        if status != _SUCCESS:
            raise Refused(f"StoreAndStart of {order['id']}: return status {status}")

    async def response(self, job_id: str) -> Answer:
        while True:
            found, _ = await self._call("JobResponseProvider", "RequestJobResponseByJobOrderID", job_id)
            states = [state.StateText.Text for state in found.JobState or []]
            if "Closed" in states or "Aborted" in states:
                break
            await asyncio.sleep(_PERIOD)
        values = {each.ID: each.Value.Value for each in found.JobResponseData}
        return {
            "outcome": values.pop("Outcome"),
            "message": values.pop("Message"),
            "started": found.StartTime.timestamp(),
            "ended": found.EndTime.timestamp(),
            "changes": json.loads(values.pop("Changes")),
            "quality": {key: value for key, value in values.items() if "." in key},
        }

    async def close(self) -> None:
        await self.client.disconnect()

    async def _call(self, name: str, method: str, *arguments: Any) -> Any:
        if name not in self._nodes:
            self._nodes[name] = await self.client.nodes.objects.get_child(f"{self.cell}:{name}")
        return await self._nodes[name].call_method(f"{self.index}:{method}", *arguments)


class MqttChannel:
    """MQTT, with paho's client. The gateway answers each command with its number.

    :param user, token: of a user with the role operate; the token signs the commands.
    :param on_state: called in the loop with job id and state, for each change of any job.
    """

    def __init__(self, host: str, port: int, user: str, token: str, on_state: Callable[[str, str], None]) -> None:
        self._loop = asyncio.get_running_loop()
        self._user, self._token = user, token
        self._on_state = on_state
        self._numbers = 0
        self._answers: dict[int, asyncio.Future[Any]] = {}
        self._responses: dict[str, asyncio.Future[Any]] = {}
        self._subscribed = asyncio.Event()
        self._client = paho.Client(CallbackAPIVersion.VERSION2)
        self._client.on_socket_open = lambda _, __, sock: sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._client.on_connect = lambda client, *_: client.subscribe("skiros2/job/#", 1)
        self._client.on_subscribe = lambda *_: self._in_loop(self._subscribed.set)
        self._client.on_message = lambda _, __, message: self._in_loop(self._on_message, message)
        self._client.connect(host, port)
        self._client.loop_start()

    async def send(self, order: Order) -> None:
        await asyncio.wait_for(self._subscribed.wait(), _TIMEOUT)
        self._numbers += 1
        answer = self._answers[self._numbers] = self._loop.create_future()
        command = sign(self._user, self._token, "store_and_start", {"request": self._numbers, "order": order})
        self._client.publish("skiros2/job/in/store_and_start", command, 1)
        data = await asyncio.wait_for(answer, _TIMEOUT)
        if not data["ok"]:
            raise Refused(data["error"]["detail"])

    async def response(self, job_id: str) -> Answer:
        return dict(await self._response(job_id))

    async def close(self) -> None:
        self._client.disconnect()
        await asyncio.to_thread(self._client.loop_stop)

    def _in_loop(self, call: Callable[..., Any], *arguments: Any) -> None:
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(call, *arguments)

    def _response(self, job_id: str) -> asyncio.Future[Any]:
        if job_id not in self._responses:
            self._responses[job_id] = self._loop.create_future()
        return self._responses[job_id]

    def _on_message(self, message: paho.MQTTMessage) -> None:
        parts = message.topic.split("/")[2:]
        if message.topic.startswith("skiros2/job/in/") or not message.payload:
            return
        data = json.loads(message.payload)
        if parts == ["answer"]:
            waiting = self._answers.pop(data["request"] or 0, None)
            if waiting is not None:
                waiting.set_result(data)
        elif parts[1] == "state":
            self._on_state(parts[0], data["state"])
        elif parts[1] == "response" and not self._response(parts[0]).done():
            self._response(parts[0]).set_result(data)
