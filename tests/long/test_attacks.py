"""Attacks at length: 20 000 requests on each interface, hostile and generated, and silent connections that never end.

The random seeds are fixed; `REQUESTS` in the environment sets another number.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from skiros2_gateway.agents.server import AgentServer
from skiros2_gateway.agents.tools import Tools
from skiros2_gateway.core.approvals import Approvals
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.http.server import Limits
from skiros2_gateway.mqtt.bridge import MqttBridge
from support.broker import broker, needs_broker
from support.hostile import Hostile, fuzz_mqtt, fuzz_opcua, fuzz_rest
from support.hostile_agents import fuzz_agents
from support.http_gateway import curl, served
from support.opcua import opcua_server
from support.schema_requests import operations_of, send_generated, served_gateway
from unit.skiros2_gateway.conftest import TOKENS, Gateway
from unit.skiros2_gateway.opcua_client import Mes
from unit.skiros2_gateway.test_hostile import check

pytestmark = pytest.mark.timeout(3600)

COUNT = int(os.environ.get("REQUESTS", "20000"))


def run(folder: Path, test: Callable[[Any], Any]) -> None:
    async def main() -> None:
        gateway = Gateway(folder / "jobs.sqlite", rate=1e9)
        await test(gateway)

    asyncio.run(main())


def test_generated_requests_are_answered_as_documented(tmp_path: Path) -> None:
    with served_gateway(tmp_path) as address:
        each = COUNT // (2 * len(operations_of(address))) + 1
        found = send_generated(address, each, number=11)
        assert {200, 401, 403, 404, 422} <= found.keys(), found
        print(f"generated requests: {sum(found.values())}: {dict(sorted(found.items()))}")


def test_rest_survives_hostile_requests(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            found = await fuzz_rest(address, TOKENS, Hostile(21), COUNT)
            assert {200, 401, 403, 404, 422} <= found.keys(), found
            check(gateway, caplog)
            print(f"REST: {dict(sorted(found.items()))}")

    run(tmp_path, test)


@needs_broker
def test_mqtt_survives_hostile_requests(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        with broker() as port:
            bridge = MqttBridge(gateway.service, Settings(mqtt=f"127.0.0.1:{port}"))
            bridge.start()
            try:
                found = await fuzz_mqtt(port, "skiros2", TOKENS, Hostile(22), COUNT)
            finally:
                await bridge.stop()
            assert {"unauthenticated", "denied", "rejected", "unknown_name"} <= found.keys(), found
            check(gateway, caplog)
            print(f"MQTT: {dict(sorted(found.items()))}")

    run(tmp_path, test)


def test_tools_of_agents_survive_hostile_requests(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        gateway.service.approvals = Approvals(gateway.events, is_needed=False, timeout=0.001)
        agents = AgentServer(gateway.service)
        fields = {name: tuple(tool.arguments.model_fields) for name, tool in Tools(gateway.service).all.items()}
        await gateway.put("a")
        gateway.cell.end("a", "failed")
        await gateway.collected("a")
        cell = gateway.cell
        async with agents.running(), served(gateway.service, routers=[agents.router()]) as address:
            found = await fuzz_agents(
                address, TOKENS, fields, Hostile(24), COUNT,
                lambda: (len(cell.sent), len(cell.commands), len(cell.skill_runs), len(cell.edits)),
            )  # fmt: skip
        assert {"200", "401", "done", "denied", "rejected", "unknown_name"} <= found.keys(), found
        check(gateway, caplog, users=("agent", "operate"))
        print(f"agents: {dict(sorted(found.items()))}")

    run(tmp_path, test)


def test_opcua_survives_hostile_requests(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        server = opcua_server(gateway.service, gateway.path.parent)
        await server.start()
        try:
            async with Mes(server.address, "operate") as mes:
                await mes.load()
                found = await fuzz_opcua(mes, mes.index, Hostile(23), COUNT)
            check(gateway, caplog)
            print(f"OPC UA: {dict(sorted(found.items()))}")
        finally:
            await server.stop()

    run(tmp_path, test)


def test_silent_connections_that_come_for_ever_leave_room(tmp_path: Path) -> None:
    async def flood(address: str) -> None:
        host, port = address.removeprefix("http://").split(":")
        opened = []
        while True:
            _, writer = await asyncio.open_connection(host, int(port))
            opened.append(writer)
            if len(opened) > 900:
                opened.pop(0).close()
            await asyncio.sleep(0.001)

    async def test(gateway: Any) -> None:
        async with served(gateway.service, limits=Limits(head=2.0)) as address:
            task = asyncio.create_task(flood(address))
            for _ in range(200):
                assert (await curl(address, "/api/health"))[0] == 200
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    run(tmp_path, test)
