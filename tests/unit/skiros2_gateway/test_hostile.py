"""Hostile requests on each interface: none stops the gateway, none is carried out without the role."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Collection
from typing import Any

import pytest

from skiros2_common.core.errors import SkirosError
from skiros2_gateway.agents.tools import Tools
from skiros2_gateway.core.approvals import Approvals
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.store import JobFilter
from skiros2_gateway.mqtt.bridge import MqttBridge
from support.broker import broker, needs_broker
from support.hostile import FORBIDDEN, Hostile, fuzz_mqtt, fuzz_opcua, fuzz_rest
from support.http_gateway import served
from support.opcua import opcua_server
from support.stand_in_cell import ROBOT
from unit.skiros2_gateway.conftest import OPERATOR, TOKENS, VIEWER
from unit.skiros2_gateway.opcua_client import Mes

Run = Callable[..., None]


def check(gateway: Any, log: pytest.LogCaptureFixture, users: Collection[str] = ("operate",)) -> None:
    """Nothing was carried out without the role, and no request has caused an internal error."""
    assert not [job.id for job in gateway.store.jobs(JobFilter(cleared=True)) if job.id.startswith(FORBIDDEN)]
    assert {entry["user"] for entry in gateway.store.audit_log() if entry["outcome"] == "done"} <= set(users)
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


def test_tools_of_agents_survive_hostile_arguments(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        gateway.service.approvals = Approvals(gateway.events, is_needed=False, timeout=0.001)
        tools = Tools(gateway.service)
        hostile = Hostile(5)
        good = ("a", "(at robot home)", "place", ROBOT, "Tray-1", 0, True, {}, [])
        found: Counter[str] = Counter()
        await gateway.put("a")
        gateway.cell.end("a", "failed")
        await gateway.collected("a")
        sent = len(gateway.cell.sent)
        for caller in [VIEWER] * 500 + [OPERATOR] * 500:
            name = hostile.random.choice([*tools.all, hostile.text()])
            fields = list(tools.all[name].arguments.model_fields) if name in tools.all else ["job"]
            chosen = hostile.random.sample([*fields, "x"], hostile.random.randrange(len(fields) + 1))
            is_good = hostile.random.random() < 0.7
            arguments = {key: hostile.random.choice(good) if is_good else hostile.value(2) for key in chosen}
            try:
                await tools.call(caller, name, arguments)
                found["done"] += 1
            except SkirosError as error:
                found[error.code] += 1
            if caller is VIEWER:
                assert (len(gateway.cell.sent), gateway.cell.commands, gateway.cell.skill_runs) == (sent, [], {})
        assert {"done", "denied", "rejected", "unknown_name"} <= found.keys(), found
        check(gateway, caplog)

    in_gateway(test)


def test_opcua_survives_hostile_requests(in_gateway: Run, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        server = opcua_server(gateway.service, gateway.path.parent)
        await server.start()
        try:
            async with Mes(server.address, "view") as viewer, Mes(server.address, "operate") as mes:
                await mes.load()  # the types are those of the process
                await fuzz_opcua(viewer, mes.index, Hostile(3), 60)
                assert not list(gateway.store.jobs(JobFilter(cleared=True)))
                await fuzz_opcua(mes, mes.index, Hostile(4), 60)
            check(gateway, caplog)
        finally:
            await server.stop()

    in_gateway(test)
