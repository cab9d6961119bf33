"""MQTT: mosquitto's command-line clients and broker, with a stand-in for the cell."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from skiros2_gateway.core.settings import Settings
from skiros2_gateway.mqtt.bridge import MqttBridge
from support.broker import broker, needs_broker
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
ORDER = {"id": "a", "goal": "(at robot home)"}

pytestmark = needs_broker


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """A broker's port."""
    with broker() as port:
        yield port


class Subscriber:
    """`mosquitto_sub` on all topics."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process

    async def until(self, topic: str, condition: Callable[[Any], Any] = lambda _: True) -> Any:
        """Returns the next message of a topic that meets a condition."""
        assert self.process.stdout is not None
        while line := (await self.process.stdout.readline()).decode():
            name, _, text = line.rstrip("\n").partition(" ")
            if name == topic:
                data = json.loads(text) if text.startswith("{") else text
                if condition(data):
                    return data
        raise AssertionError(f"no message of {topic}")


@asynccontextmanager
async def connected(gateway: Any, port: int, prefix: str) -> AsyncIterator[tuple[MqttBridge, Subscriber]]:
    await publish(port, f"{prefix}/subscribed", "yes", "-r")
    command = ("mosquitto_sub", "-p", str(port), "-v", "-t", f"{prefix}/#")
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    subscriber = Subscriber(process)
    await subscriber.until(f"{prefix}/subscribed")
    bridge = MqttBridge(gateway.service, Settings(mqtt=f"127.0.0.1:{port}", mqtt_prefix=prefix))
    bridge.start()
    try:
        await subscriber.until(f"{prefix}/status", lambda text: text == "online")
        yield bridge, subscriber
    finally:
        await bridge.stop()
        process.kill()
        await process.wait()


async def publish(port: int, topic: str, data: Any, *options: str) -> None:
    text = data if isinstance(data, str) else json.dumps(data)
    process = await asyncio.create_subprocess_exec(
        "mosquitto_pub", "-p", str(port), "-q", "1", "-t", topic, "-m", text, *options
    )
    assert await process.wait() == 0


def test_job_comes_in_and_its_state_and_response_go_out(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "one") as (_, subscriber):
            order = {"token": TOKENS["operate"], "order": ORDER, "request": 7}
            await publish(port, "one/job/in/store_and_start", order)
            answer = await subscriber.until("one/job/answer")
            assert (answer["ok"], answer["request"], answer["id"]) == (True, 7, "a")
            gateway.cell.run("a")
            await subscriber.until("one/job/a/state", lambda state: state["state"] == "Running")
            gateway.cell.end("a")
            assert (await subscriber.until("one/job/a/response"))["outcome"] == "succeeded"
            await publish(port, "one/job/in/clear", {"token": TOKENS["operate"], "id": "a"})
            await subscriber.until("one/job/a/response", lambda text: text == "(null)")

    in_gateway(test)


def test_command_without_the_role_or_with_mistakes_is_refused(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "two") as (_, subscriber):
            token = TOKENS["operate"]
            for method, data, code in (
                ("store", {"order": ORDER}, "unauthenticated"),
                ("store", {"order": ORDER, "token": TOKENS["view"]}, "denied"),
                ("store", {"order": {"id": ""}, "token": token}, "rejected"),
                ("jump", {"token": token}, "unknown_name"),
                ("start", {"id": "b", "token": token}, "unknown_name"),
                ("start", "{", "rejected"),
            ):
                await publish(port, f"two/job/in/{method}", data)
                assert (await subscriber.until("two/job/answer"))["error"]["code"] == code
            assert not list(gateway.store.jobs())

    in_gateway(test)


def test_state_is_retained_and_the_last_will_reports_the_end(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        prefix = "three"
        async with connected(gateway, port, prefix) as (bridge, subscriber):
            await gateway.put("a")
            element = await subscriber.until(f"{prefix}/world/Tray-1")
            assert element["type"] == "demo:Tray"
            command = ["mosquitto_sub", "-p", str(port), "-C", "2", "-W", "10", "-t", f"{prefix}/cell"]
            command += ["-t", f"{prefix}/job/a/state"]
            late = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
            out = (await late.communicate())[0].decode()
            assert '"AllowedToStart"' in out and '"/robot"' in out
            bridge._client._sock_close()  # as when the process is killed
            await subscriber.until(f"{prefix}/status", lambda text: text == "offline")
            await subscriber.until(f"{prefix}/status", lambda text: text == "online")

    in_gateway(test)


def test_retained_command_is_refused(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        order = {"token": TOKENS["operate"], "order": ORDER}
        await publish(port, "four/job/in/store_and_start", order, "-r")
        async with connected(gateway, port, "four") as (_, subscriber):
            answer = await subscriber.until("four/job/answer")
            assert "retained" in answer["error"]["detail"]
            assert not gateway.cell.sent

    in_gateway(test)


