"""Each input of the corpus on its interface: the gateway answers the next client as if nothing had come."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable
from typing import Any

import paho.mqtt.publish
import pytest
from asyncua import ua

from skiros2_common.core.world_element import Element
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.work_masters import DEFINITION, WORK_MASTER, work_masters_of
from skiros2_gateway.mqtt.bridge import MqttBridge
from skiros2_gateway.mqtt.signature import sign
from skiros2_live.core.element_data import element_data
from support import hostile_corpus
from support.broker import broker, needs_broker
from support.http_gateway import curl, served
from support.opcua import cell_index, opcua_server
from unit.skiros2_gateway.conftest import TOKENS
from unit.skiros2_gateway.opcua_client import Mes

Run = Callable[..., None]

#: These are orders, though strange ones.
VALID = ("body: far time",)


async def send(host: str, port: int, data: bytes) -> bytes:
    """Sends data, and returns what is answered within a moment."""
    reader, writer = await asyncio.open_connection(host, port)
    try:
        writer.write(data)
        return await asyncio.wait_for(reader.read(10_000), 0.15)
    except (TimeoutError, ConnectionError):
        return b""
    finally:
        writer.close()


def errors(log: pytest.LogCaptureFixture) -> list[str]:
    """The errors of the gateway, not those that libraries log about clients."""
    records = [r for r in log.records if r.levelno >= logging.ERROR and r.name.startswith("skiros2")]
    return [record.getMessage() for record in records]


def element_of(eid: str, value: Any) -> dict[str, Any]:
    element = Element("skiros:Product", "", eid)
    element.setProperty("skiros:Weight", value)
    return element_data(element)


def test_http(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            host, _, port = address.removeprefix("http://").partition(":")
            for name, data in hostile_corpus.HTTP.items():
                answer = await send(host, int(port), data.replace(b"TOKEN", TOKENS["operate"].encode()))
                status = answer.split()[1] if answer else b""
                assert status < b"5" and (status != b"201" or name in VALID), (name, answer)
                assert (await curl(address, "/api/health"))[0] == 200, name
        assert not errors(caplog)

    in_gateway(test)


@needs_broker
def test_mqtt(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        with broker() as port:
            bridge = MqttBridge(gateway.service, Settings(mqtt=f"127.0.0.1:{port}"))
            bridge.start()
            try:
                good = sign("operate", TOKENS["operate"], "store", {"order": {"id": "good", "goal": "(x)"}})
                payloads = [*hostile_corpus.MQTT.values(), good]
                messages = [("skiros2/job/in/store", payload, 1, False) for payload in payloads]
                while not bridge._client.is_connected():
                    await asyncio.sleep(0.02)
                for eid in hostile_corpus.IDS:
                    for value in hostile_corpus.VALUES:
                        gateway.cell.change(**{eid: element_of(eid, value)})
                        await asyncio.sleep(0)  # each is published
                while not gateway.store.get("good"):  # the bridge may not have subscribed yet
                    await asyncio.to_thread(paho.mqtt.publish.multiple, messages, "127.0.0.1", port)
                    await asyncio.sleep(0.1)
                await gateway.put("last")
            finally:
                await bridge.stop()
            assert [job.id for job in gateway.store.jobs()] == ["last", "good"]
            assert not [text for text in errors(caplog) if "MQTT topic" not in text]  # some topics are too long

    in_gateway(test)


def test_opcua(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        server = opcua_server(gateway.service, gateway.path.parent)
        await server.start()
        try:
            host, _, port = server.address.removeprefix("opc.tcp://").partition("/")[0].partition(":")
            for data in hostile_corpus.OPCUA.values():
                await send(host, int(port), data)
            for eid in hostile_corpus.IDS:
                gateway.cell.change(**{eid: element_of(eid, 1.0)})
            for number, value in enumerate(hostile_corpus.VALUES):
                gateway.cell.change(**{f"Value-{number}": element_of(f"Value-{number}", value)})
            gateway.cell.change(**{"Last-1": element_of("Last-1", 7.0)})
            async with Mes(server.address, "view") as mes:
                index = await cell_index(mes)
                node = mes.get_node(ua.NodeId("World/Last-1/skiros:Weight", index))
                for _ in range(500):
                    try:
                        assert await node.read_value() == 7.0
                        return
                    except ua.UaStatusCodeError:  # not shown yet
                        await asyncio.sleep(0.02)
                raise AssertionError("the last element is not shown")
        finally:
            await server.stop()

    in_gateway(test)


@pytest.mark.parametrize("text", hostile_corpus.WORK_MASTERS)
def test_work_master(text: str) -> None:
    element = Element(WORK_MASTER, "m", "m")
    element.setProperty(DEFINITION, text)
    masters, problems = work_masters_of([element])
    assert not masters and len(problems) == 1


@pytest.mark.parametrize("value", hostile_corpus.VALUES)
def test_value_of_an_element_is_json(value: Any) -> None:
    json.dumps(element_of("Box-1", value), allow_nan=False)
