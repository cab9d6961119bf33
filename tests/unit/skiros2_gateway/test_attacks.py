"""Attacks on the gateway's interfaces, one test each."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from skiros2_common.core.world_element import Element
from skiros2_gateway.core import approvals, store
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.job import Job, Order, read_order
from skiros2_gateway.core.json_text import json_text
from skiros2_gateway.core.problems import Rejected
from skiros2_gateway.core.settings import Settings
from skiros2_gateway.core.store import JobStore
from skiros2_gateway.core.work_masters import WorkMaster
from skiros2_gateway.http.body_limit import MAX_BODY, TIMEOUT
from skiros2_gateway.http.server import Limits
from skiros2_gateway.mqtt import signature
from skiros2_gateway.opcua import server as opcua
from skiros2_live.core.element_data import element_data
from support.http_gateway import curl, served
from support.source import ROOT
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
NOT_FINITE = [math.nan, math.inf, -math.inf]


def master(goal: str, *names: str, kind: str = "string") -> WorkMaster:
    return WorkMaster.model_validate(
        {"id": "m", "goal": goal, "parameters": [{"id": name, "type": kind} for name in names]}
    )


def strict(text: str | bytes) -> Any:
    """Reads JSON as other languages do: without NaN and infinities."""

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


# -- numbers -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [*NOT_FINITE, 10**40, -(10**40)])
def test_number_that_not_every_interface_can_carry_is_refused(value: float) -> None:
    with pytest.raises(Rejected, match="64 bits"):
        read_order({"id": "a", "work_master": "m", "parameters": {"P": value}})


@pytest.mark.parametrize("value", NOT_FINITE)
def test_limit_of_a_work_master_is_finite(value: float) -> None:
    with pytest.raises(ValidationError):
        WorkMaster.model_validate(
            {"id": "m", "goal": "({P})", "parameters": [{"id": "P", "type": "number", "maximum": value}]}
        )
    with pytest.raises(ValidationError):
        WorkMaster.model_validate(
            {"id": "m", "goal": "({P})", "parameters": [{"id": "P", "type": "number", "default": value}]}
        )


def test_numbers_that_json_lacks_are_sent_as_texts() -> None:
    data = {"a": [math.nan, 1.5], "b": {"c": -math.inf}, "d": (math.inf, True, None)}
    assert strict(json_text(data)) == {"a": ["nan", 1.5], "b": {"c": "-inf"}, "d": ["inf", True, None]}
    event = EventStream().publish("world", data)
    assert strict(event.json)["data"]["a"][0] == "nan"


def test_element_with_numbers_that_json_lacks_is_json() -> None:
    element = Element("skiros:Product", "box", "skiros:Product-1")
    element.setProperty("skiros:Weight", math.nan)
    assert element_data(element)["properties"]["skiros:Weight"] == ["nan"]


def test_json_texts_have_no_invisible_characters() -> None:
    data = {"Tray\u202e": "\x1b[2J\u200b\x7f\u2028ä"}
    assert json_text(data).isprintable()
    assert json_text(data).isascii()
    assert json.loads(json_text(data)) == data


@pytest.mark.parametrize("path", ["/api/jobs", "/api/audit"])
def test_number_beyond_the_store_is_refused(in_gateway: Run, path: str) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            query = f"{path}?since=99999999999999999999"
            assert (await curl(address, query, token=TOKENS["maintain"]))[0] == 422

    in_gateway(test)


@pytest.mark.parametrize("number", ["²", "9" * 5000, "٣"])
def test_strange_number_of_an_event_means_a_reset(number: str) -> None:
    events = EventStream()
    events.publish("job", {})
    assert [event.kind for event in events._missed(f"{events.name}-{number}")] == ["reset"]


@pytest.mark.parametrize("value", [10**40, math.nan])
def test_job_that_an_earlier_version_has_stored_is_read(value: float) -> None:
    job = Job(Order(id="a", goal="g"), "g", 1, 0.0, 0.0)
    data = job.to_dict()
    data["order"]["parameters"]["P"] = value
    assert str(Job.from_dict(data).order.parameters["P"]) == str(value)


# -- sizes -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("goal", ["({P:>200000000})", "({P!r})", "({P:{P}})"])
def test_format_of_a_value_is_refused(goal: str) -> None:
    with pytest.raises(ValidationError, match="expected"):
        master(goal, "P")


def test_goal_with_long_values_is_refused_before_it_is_made() -> None:
    with pytest.raises(Rejected, match="characters"):
        master("({P})" * 2000, "P").goal_for({"P": "x" * 200_000})


# -- files -------------------------------------------------------------------------------------------------------------


def test_store_is_readable_by_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "jobs.sqlite"
    path.write_bytes(b"")
    path.chmod(0o644)  # as earlier versions made it
    store = JobStore(path)
    store.audit(dict.fromkeys(("time", "user", "way", "action", "object", "outcome"), 0))
    modes = {file.name: oct(file.stat().st_mode & 0o777) for file in tmp_path.iterdir()}
    assert modes == dict.fromkeys(("jobs.sqlite", "jobs.sqlite-wal", "jobs.sqlite-shm"), "0o600")
    store.close()


def test_folder_is_for_its_owner_only(tmp_path: Path) -> None:
    for name in ("new", "known"):
        if name == "known":
            (tmp_path / name).mkdir(mode=0o755)
        settings = Settings(folder=tmp_path / name)
        settings.make_folder()
        assert oct((tmp_path / name).stat().st_mode & 0o777) == "0o700"


# -- settings ----------------------------------------------------------------------------------------------------------


def test_remote_broker_needs_tls() -> None:
    with pytest.raises(ValidationError, match="mqtt_ca"):
        Settings(mqtt="broker.factory:1883")
    for fields in ({"mqtt": "127.0.0.1:1883"}, {"mqtt": "localhost"}, {"mqtt": "broker.factory", "mqtt_ca": "ca.pem"}):
        Settings.model_validate(fields)


def test_host_on_the_network_needs_a_certificate() -> None:
    for host in ("0.0.0.0", "192.168.1.2", "::", "cell.factory"):
        with pytest.raises(ValidationError, match="needs a certificate and a key"):
            Settings(host=host)
        Settings(host=host, certificate="cell.pem", key="key.pem")
    with pytest.raises(ValidationError, match="belong together"):
        Settings(certificate="cell.pem")


def test_limits_are_those_that_are_promised() -> None:
    text = " ".join((ROOT / "SECURITY.md").read_text().split())
    limits, settings = Limits(), Settings()
    assert limits.of_address == settings.connections
    assert settings.max_body == MAX_BODY
    for promise in (
        f"at most {limits.of_address} connections (`connections`), all have {limits.total}",
        f"The head of a request has {limits.head:g} s, its body {TIMEOUT:g} s and {MAX_BODY // 1024} kB",
        f"OPC UA has {opcua._MAX_CONNECTIONS} connections, each with {opcua._LOGIN_TIMEOUT:g} s to log in",
        f"Each user has {settings.rate:g} requests per second",
        f"the last {signature._KEPT:_} commands are known".replace("_", " "),
    ):
        assert promise in text
    text = " ".join((ROOT / "docs/factory.md").read_text().split())
    for promise in (
        f"answers within {settings.approval_timeout:g} s (`approval_timeout`)",
        f"At most {approvals.MAX_OPEN_OF_USER} requests of a user wait, and {approvals.MAX_OPEN} in all",
        f"keeps the newest {store._MAX_KEYS} keys of each user",
        f"at most {store._MAX_AUDIT:,} entries of the audit log",
    ):
        assert promise in text


# -- logins ------------------------------------------------------------------------------------------------------------


def test_failed_logins_are_in_the_audit_log_in_few_entries(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            for _ in range(15):
                assert (await curl(address, "/api/state", token="guess"))[0] == 401
        found = gateway.access.audit_log()
        entry = ("", "rest", "log in", "127.0.0.1")
        assert [(e["user"], e["way"], e["action"], e["object"]) for e in found] == [entry] * 2
        assert "14 more" in found[1]["outcome"]

    in_gateway(test)


def test_denied_requests_do_not_fill_the_audit_log(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            for number in range(30):
                body = {"id": f"job-{number}", "goal": "(at robot home)"}
                assert (await curl(address, "/api/jobs", token=TOKENS["view"], body=body))[0] == 403
        found = gateway.access.audit_log()
        assert [(entry["user"], entry["object"]) for entry in found] == [("view", "job-0"), ("view", "job-29")]
        assert "29 more" in found[1]["outcome"]

    in_gateway(test)


def test_header_of_a_proxy_does_not_hide_an_address(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            found = await asyncio.gather(
                *(
                    curl(address, "/api/state", "-H", f"X-Forwarded-For: 10.0.0.{number}", token="guess")
                    for number in range(60)
                )
            )
            assert {status for status, _ in found} == {401, 429}

    in_gateway(test)
