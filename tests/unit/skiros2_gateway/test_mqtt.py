"""MQTT: mosquitto's command-line clients and broker, with a stand-in for the cell."""

from __future__ import annotations

import asyncio
import getpass
import json
import logging
import math
import os
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from skiros2_gateway.core.job import Method
from skiros2_gateway.core.problems import Unauthenticated
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.mqtt import signature
from skiros2_gateway.mqtt.bridge import MqttBridge
from skiros2_gateway.mqtt.signature import Freshness, sign
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

    async def next_removed(self) -> str:
        """Returns the topic of the next empty message."""
        assert self.process.stdout is not None
        while line := (await self.process.stdout.readline()).decode():
            name, _, text = line.rstrip("\n").partition(" ")
            if text == "(null)":
                return name
        raise AssertionError("no topic is removed")


@asynccontextmanager
async def connected(
    gateway: Any, port: int, prefix: str, **settings: Any
) -> AsyncIterator[tuple[MqttBridge, Subscriber]]:
    await publish(port, f"{prefix}/subscribed", "yes", "-r")
    command = ("mosquitto_sub", "-p", str(port), "-v", "-t", f"{prefix}/#")
    process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    subscriber = Subscriber(process)
    await subscriber.until(f"{prefix}/subscribed")
    bridge = MqttBridge(gateway.service, Settings(mqtt=f"127.0.0.1:{port}", mqtt_prefix=prefix, **settings))
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


def message(method: str, fields: dict[str, Any], user: str = "operate", now: float | None = None) -> str:
    return sign(user, TOKENS[user], method, fields, now)


async def command(port: int, prefix: str, method: str, fields: dict[str, Any]) -> None:
    await publish(port, f"{prefix}/job/in/{method}", message(method, fields))


def test_job_comes_in_and_its_state_and_response_go_out(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "one") as (_, subscriber):
            await command(port, "one", "store_and_start", {"order": ORDER, "request": 7})
            answer = await subscriber.until("one/job/answer")
            assert (answer["ok"], answer["request"], answer["id"]) == (True, 7, "a")
            gateway.cell.run("a")
            await subscriber.until("one/job/a/state", lambda state: state["state"] == "Running")
            gateway.cell.end("a")
            assert (await subscriber.until("one/job/a/response"))["outcome"] == "succeeded"
            await command(port, "one", "clear", {"id": "a"})
            await subscriber.until("one/job/a/response", lambda text: text == "(null)")

    in_gateway(test)


def test_command_with_a_key_is_carried_out_once(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "keys") as (_, subscriber):
            await gateway.put("a", start=False)
            for _ in range(2):
                await command(port, "keys", "start", {"id": "a", "key": "k"})
                assert (await subscriber.until("keys/job/answer"))["ok"]
            assert [entry["method"] for entry in gateway.store.history("a")].count("Start") == 1
            await command(port, "keys", "abort", {"id": "a", "key": "k"})
            assert (await subscriber.until("keys/job/answer"))["error"]["code"] == "conflict"

    in_gateway(test)


def test_command_without_the_role_or_with_mistakes_is_refused(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "two") as (_, subscriber):
            signed = json.loads(message("store", {"order": ORDER}))
            for method, data, code in (
                ("store", {"order": ORDER}, "unauthenticated"),
                ("store", {"order": ORDER, "token": TOKENS["operate"]}, "unauthenticated"),
                ("start", signed, "unauthenticated"),  # it was signed for another method
                ("store", {**signed, "command": signed["command"].replace("home", "away")}, "unauthenticated"),
                ("store", {**signed, "user": "maintain"}, "unauthenticated"),
                ("store", {**signed, "signature": "ä"}, "unauthenticated"),
                ("store", {**signed, "command": "[]"}, "rejected"),
                ("store", message("store", {"order": ORDER}, now=time.time() - 100.0), "unauthenticated"),
                ("store", message("store", {"order": ORDER, "time": math.nan}), "unauthenticated"),
                ("store", message("store", {"order": ORDER}, "view"), "denied"),
                ("store", message("store", {"order": {"id": ""}}), "rejected"),
                ("store", message("store", {"order": ORDER}, "agent"), "denied"),
                ("jump", message("jump", {}), "unknown_name"),
                ("start", message("start", {"id": "b"}), "unknown_name"),
                ("start", "{", "rejected"),
            ):
                await publish(port, f"two/job/in/{method}", data)
                assert (await subscriber.until("two/job/answer"))["error"]["code"] == code
            assert not list(gateway.store.jobs())

    in_gateway(test)


def test_used_command_is_refused_after_a_restart_too(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a", start=False)
        used = message("start", {"id": "a"})
        async with connected(gateway, port, "again") as (_, subscriber):
            await publish(port, "again/job/in/start", used)
            assert (await subscriber.until("again/job/answer"))["ok"]
        gateway.restart()
        async with connected(gateway, port, "again") as (_, subscriber):
            await publish(port, "again/job/in/start", used)
            error = (await subscriber.until("again/job/answer"))["error"]
            assert (error["code"], error["detail"]) == ("unauthenticated", "the command was received before")

    in_gateway(test)


@pytest.mark.parametrize("key", ["", "k"])
def test_stop_does_not_wait_for_the_disk(in_gateway: Run, port: int, key: str) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("a")
        gateway.cell.run("a")
        stopped: list[list[str]] = []

        def noted(write: Any) -> Any:
            def slow(*arguments: Any) -> None:
                stopped.append(list(gateway.cell.stopped))
                write(*arguments)

            return slow

        for name in ("put_signature", "put_key", "save"):
            setattr(gateway.store, name, noted(getattr(gateway.store, name)))
        async with connected(gateway, port, "disk") as (_, subscriber):
            used = message("stop", {"id": "a", "key": key})
            await publish(port, "disk/job/in/stop", used)
            assert (await subscriber.until("disk/job/answer"))["ok"]
            assert stopped and all(each == ["a"] for each in stopped)
        gateway.restart()
        async with connected(gateway, port, "disk") as (_, subscriber):
            await publish(port, "disk/job/in/stop", used)
            assert (await subscriber.until("disk/job/answer"))["error"]["code"] == "unauthenticated"

    in_gateway(test)


def test_signatures_are_bounded_in_number_but_kept_for_two_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(signature, "_KEPT", 2)
    now = 1000.0
    store = JobStore(tmp_path / "jobs.db")
    freshness = Freshness(store, lambda: now, lambda: now)
    for number in range(5):
        freshness.check(f"{number}", now)
        asyncio.run(freshness.write())
        now += 70.0
    assert set(store.signatures()) == {"3", "4"}
    for key in "abcd":
        freshness.check(key, now)
        asyncio.run(freshness.write())
    assert set(store.signatures()) == {"4", *"abcd"}  # the clocks may differ by a minute
    with pytest.raises(Unauthenticated, match="received before"):
        Freshness(JobStore(tmp_path / "jobs.db"), lambda: now).check("4", now)


@pytest.mark.parametrize("days", [-1, 1])
def test_command_is_carried_out_once_when_the_clock_is_set(tmp_path: Path, days: int) -> None:
    now, elapsed = sent, _ = 1e9, 0.0
    freshness = Freshness(JobStore(tmp_path / "jobs.db"), lambda: now, lambda: elapsed)
    freshness.check("a", sent)
    asyncio.run(freshness.write())
    elapsed, now = 1000.0, sent + days * 86_400.0
    freshness.check("b", now)
    asyncio.run(freshness.write())
    now = sent
    for each in (freshness, Freshness(JobStore(tmp_path / "jobs.db"), lambda: now)):
        with pytest.raises(Unauthenticated, match="received before"):
            each.check("a", sent)


def test_topics_of_a_job_are_never_those_of_commands(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "names") as (_, subscriber):
            await gateway.put("in")
            await subscriber.until("names/job/%69n/state", lambda state: state["substate"] == "Loaded")
            gateway.cell.run("in")
            gateway.cell.end("in")
            await subscriber.until("names/job/%69n/response")
            command = ("mosquitto_sub", "-p", str(port), "-W", "1", "-v", "-t", "names/job/in/#")
            retained = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
            assert (await retained.communicate())[0] == b""
        gateway.restart()
        async with connected(gateway, port, "names") as (_, subscriber):
            assert (await subscriber.until("names/job/%69n/response"))["outcome"] == "succeeded"
            gateway.control.apply(Method.CLEAR, "in", "test")
            assert await subscriber.next_removed() == "names/job/%69n/response"

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


def test_broker_without_memory_gets_the_jobs_that_have_ended(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        for name in ("kept", "cleared"):
            await gateway.put(name)
            gateway.cell.run(name)
            gateway.cell.end(name)
            await gateway.collected(name)
        gateway.control.apply(Method.CLEAR, "cleared", "test")
        gateway.restart()  # it has died before anything was published
        async with connected(gateway, port, "memory") as (bridge, subscriber):
            assert (await subscriber.until("memory/job/kept/response"))["outcome"] == "succeeded"
            assert (await subscriber.until("memory/job/kept/state"))["state"] == "Ended"
            await publish(port, "memory/job/kept/response", "", "-r")  # as a broker that has lost it
            bridge._client._sock_close()
            assert (await subscriber.until("memory/job/kept/response", lambda data: "outcome" in data))["steps"]

    in_gateway(test)


def test_retained_topics_of_jobs_that_are_gone_are_removed(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        await gateway.put("open")
        for name in ("gone", "open"):
            await publish(port, f"stale/job/{name}/state", {"state": "Running"}, "-r")
            await publish(port, f"stale/job/{name}/response", {"outcome": "succeeded"}, "-r")
        async with connected(gateway, port, "stale") as (_, subscriber):
            wanted = {"stale/job/gone/state", "stale/job/gone/response", "stale/job/open/response"}
            while wanted:
                topic = await subscriber.next_removed()
                assert topic in wanted
                wanted.discard(topic)

    in_gateway(test)


def test_retained_command_is_refused(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        await publish(port, "four/job/in/store_and_start", message("store_and_start", {"order": ORDER}), "-r")
        async with connected(gateway, port, "four") as (_, subscriber):
            answer = await subscriber.until("four/job/answer")
            assert "retained" in answer["error"]["detail"]
            assert not gateway.cell.sent

    in_gateway(test)


def test_command_that_comes_again_is_refused(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "five") as (_, subscriber):
            gateway.cell.run((await gateway.put("b")).id)
            gateway.cell.run("b")
            text = message("pause", {"id": "b"})
            await publish(port, "five/job/in/pause", text)
            assert (await subscriber.until("five/job/answer"))["ok"]
            await publish(port, "five/job/in/pause", text)
            assert "before" in (await subscriber.until("five/job/answer"))["error"]["detail"]

    in_gateway(test)


def test_tokens_in_commands_are_accepted_only_by_a_setting(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "six", mqtt_tokens=True) as (_, subscriber):
            await publish(port, "six/job/in/store", {"order": ORDER, "token": TOKENS["operate"], "request": 3})
            answer = await subscriber.until("six/job/answer")
            assert (answer["ok"], answer["request"]) == (True, 3)

    in_gateway(test)


def test_signing_program_prints_a_command(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "seven") as (_, subscriber):
            arguments = ["operate", "store", json.dumps({"order": ORDER})]
            program = [sys.executable, "-m", "skiros2_gateway.mqtt.signature", *arguments]
            env = {**os.environ, "TOKEN": TOKENS["operate"], "PYTHONPATH": os.pathsep.join(sys.path)}
            text = subprocess.run(program, env=env, capture_output=True, text=True, check=True).stdout
            await publish(port, "seven/job/in/store", text.strip())
            assert (await subscriber.until("seven/job/answer"))["ok"]

    in_gateway(test)


@pytest.mark.parametrize(("eid", "part"), [("x#y", "x%23y"), ("x+y/z", "x%2By%2Fz"), ("Tür:1", "Tür:1"), ("%", "%25")])
def test_element_with_any_id_has_a_topic(in_gateway: Run, port: int, eid: str, part: str) -> None:
    async def test(gateway: Any) -> None:
        prefix = f"ids{ord(eid[-1])}"
        async with connected(gateway, port, prefix) as (_, subscriber):
            element = {"id": eid, "type": "demo:Tray", "label": "", "properties": {}, "relations": []}
            gateway.cell.change(**{eid: element})
            assert (await subscriber.until(f"{prefix}/world/{part}"))["id"] == eid
            gateway.cell.change(**{eid: None})
            await subscriber.until(f"{prefix}/world/{part}", lambda text: text == "(null)")

    in_gateway(test)


@pytest.mark.parametrize("data", [{"answer": 3}, {}, None, {"job": "x" * 70_000}])
def test_event_that_cannot_be_published_costs_no_other(in_gateway: Run, port: int, data: Any) -> None:
    async def test(gateway: Any) -> None:
        prefix = f"broken{len(str(data))}"
        async with connected(gateway, port, prefix) as (_, subscriber):
            gateway.events.publish("response", data)
            await gateway.put("a")
            await subscriber.until(f"{prefix}/job/a/state", lambda state: state["state"] == "AllowedToStart")

    in_gateway(test)


def test_element_that_cannot_be_published_costs_no_other(in_gateway: Run, port: int) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "elements") as (_, subscriber):
            gateway.cell.change(**{"x" * 70_000: {"id": "x"}, "Bad": {"id": {1, 2}}, "Good": {"id": "Good"}})
            assert await subscriber.until("elements/world/Good") == {"id": "Good"}

    in_gateway(test)


def test_bridge_continues_after_an_internal_error(in_gateway: Run, port: int, caplog: pytest.LogCaptureFixture) -> None:
    async def test(gateway: Any) -> None:
        async with connected(gateway, port, "internal") as (_, subscriber):
            await subscriber.until("internal/world/Tray-1")
            state = gateway.cell.state

            def broken() -> Any:
                gateway.cell.state = state
                raise RuntimeError("something unforeseen")

            gateway.cell.state = broken
            gateway.events.publish("reset", {})
            await subscriber.until("internal/world/Tray-1")
            await gateway.put("a")
            await subscriber.until("internal/job/a/state")
            assert "something unforeseen" in caplog.text

    in_gateway(test)


def test_refused_login_is_no_connection(in_gateway: Run, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)

    async def test(gateway: Any) -> None:
        passwords = tmp_path / "passwords"
        subprocess.run(["mosquitto_passwd", "-c", "-b", str(passwords), "mes", "secret"], check=True)
        with broker(f"user {getpass.getuser()}\nallow_anonymous false\npassword_file {passwords}\n") as port:
            bridge = MqttBridge(gateway.service, Settings(mqtt=f"127.0.0.1:{port}"))
            bridge.start()
            try:
                while not (texts := [r.getMessage() for r in caplog.records if r.name.endswith("bridge")]):
                    await asyncio.sleep(0.02)
            finally:
                await bridge.stop()
            assert "refuses" in texts[0]
            assert not [text for text in texts if text.startswith("connected")]

    in_gateway(test)
