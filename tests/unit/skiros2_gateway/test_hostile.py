"""Hostile requests on each interface: none stops the gateway, none is carried out without the role."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_gateway.core.settings import Settings
from skiros2_gateway.mqtt.bridge import MqttBridge
from skiros2_gateway.opcua.server import OpcuaServer
from support.broker import broker, needs_broker
from support.hostile import FORBIDDEN, Hostile, fuzz_mqtt, fuzz_opcua, fuzz_rest
from support.http_gateway import served
from unit.skiros2_gateway.conftest import TOKENS
from unit.skiros2_gateway.test_opcua import Mes

Run = Callable[..., None]


def check(gateway: Any, log: pytest.LogCaptureFixture) -> None:
    """Nothing was carried out without the role, and no request has caused an internal error."""
    assert not [job.id for job in gateway.store.jobs(cleared=True) if job.id.startswith(FORBIDDEN)]
    assert {entry["user"] for entry in gateway.store.audit_log() if entry["outcome"] == "done"} <= {"operate"}
    errors = [record for record in log.records if record.levelno >= logging.ERROR and not _is_of_asyncua(record)]
    assert not errors, [record.getMessage() for record in errors]


def _is_of_asyncua(record: logging.LogRecord) -> bool:
    """asyncua logs the error of each call with a wrong status as an error."""
    return record.name.startswith("asyncua")


def test_rest_survives_hostile_requests(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            found = await fuzz_rest(address, TOKENS, Hostile(1), 400)
            assert {200, 401, 403, 404, 422} <= found.keys(), found
            check(gateway, caplog)

    in_gateway(test)


@needs_broker
def test_mqtt_survives_hostile_requests(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        with broker() as port:
            bridge = MqttBridge(gateway.service, Settings(mqtt=f"127.0.0.1:{port}"))
            bridge.start()
            try:
                found = await fuzz_mqtt(port, "skiros2", TOKENS, Hostile(2), 100)
            finally:
                await bridge.stop()
            assert {"unauthenticated", "denied", "rejected", "unknown_name"} <= found.keys(), found
            check(gateway, caplog)

    in_gateway(test)


def test_opcua_survives_hostile_requests(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        server = OpcuaServer(gateway.service, Settings(folder=gateway.path.parent, opcua_port=0))
        await server.start()
        try:
            async with Mes(server.address, "view") as viewer, Mes(server.address, "operate") as mes:
                await mes.load()  # the types are those of the process
                await fuzz_opcua(viewer, mes.index, Hostile(3), 60)
                assert not list(gateway.store.jobs(cleared=True))
                await fuzz_opcua(mes, mes.index, Hostile(4), 60)
            check(gateway, caplog)
        finally:
            await server.stop()

    in_gateway(test)
