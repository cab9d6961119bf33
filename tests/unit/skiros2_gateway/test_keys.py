"""Idempotency keys: a command that is sent again with its key is carried out once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from skiros2_common.core.errors import Conflict, Refused, SkirosError, TimedOut
from skiros2_gateway.core.keys import MAX_KEY
from skiros2_gateway.core.problems import Rejected
from skiros2_world_model.core.wm_errors import WmException
from support.http_gateway import curl, served
from support.stand_in_cell import ROBOT
from unit.skiros2_gateway.conftest import TOKENS

Run = Callable[..., None]
TOKEN = TOKENS["operate"]
KEY = ("-H", "Idempotency-Key: k")


def test_command_with_a_key_is_carried_out_once_also_after_a_restart(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async def stop(*options: str, robots: tuple[str, ...] = (ROBOT,), token: str = TOKEN) -> tuple[int, Any]:
            return await curl(address, "/api/robots/stop", *options, token=token, body={"robots": robots})

        async with served(gateway.service) as address:
            answers = await asyncio.gather(*(stop(*KEY) for _ in range(3)))
            assert answers == [(200, {ROBOT: 1})] * 3
            assert gateway.cell.commands == [("stop", [ROBOT])]
            status, problem = await stop(*KEY, robots=())
            assert (status, problem["code"]) == (409, "conflict")
            assert (await stop(*KEY, token=TOKENS["maintain"]))[0] == 200  # the keys of users are their own
            assert (await stop())[0] == 200
            assert len(gateway.cell.commands) == 3
        gateway.store.close()
        gateway.restart()
        async with served(gateway.service) as address:
            assert await stop(*KEY) == (200, {ROBOT: 1})
            assert not gateway.cell.commands

    in_gateway(test)


def test_refused_command_may_be_sent_again_with_its_key(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            start = ("/api/jobs/a/start", "-X", "POST", *KEY)
            assert (await curl(address, *start, token=TOKENS["view"]))[0] == 403
            assert (await curl(address, *start, token=TOKEN))[0] == 404
            await gateway.put("a", start=False)
            assert (await curl(address, *start, token=TOKEN))[0] == 200
            assert (await curl(address, *start, token=TOKEN))[1]["id"] == "a"  # without the key: 409
            methods = [entry["method"] for entry in gateway.store.history("a")]
            assert methods.count("Start") == 1
            large = {"description": "x" * 20_000}
            assert (await curl(address, "/api/jobs", *KEY, token=TOKEN, body=large))[0] == 413
            assert (await curl(address, "/api/jobs", *KEY, body={}))[0] == 401

    in_gateway(test)


@pytest.mark.parametrize("error", [TimedOut("no answer"), WmException("the service broke off")])
def test_command_whose_end_is_unknown_is_not_repeated(in_gateway: Run, error: SkirosError) -> None:
    async def test(gateway: Any) -> None:
        calls = 0

        async def slow() -> None:
            nonlocal calls
            calls += 1
            raise error

        keys = gateway.service.keys
        with pytest.raises(type(error)):
            await keys.once("operate", "k", [], slow)
        with pytest.raises(Conflict, match="unknown how the command"):
            await keys.once("operate", "k", [], slow)
        killed = asyncio.create_task(keys.once("operate", "killed", [], asyncio.Event().wait))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        gateway.restart()
        with pytest.raises(Conflict, match="unknown how the command"):
            await gateway.service.keys.once("operate", "killed", [], slow)
        assert calls == 1
        killed.cancel()

    in_gateway(test)


def test_wrong_keys_are_rejected_and_old_ones_forgotten(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        calls: list[str] = []

        async def do() -> int:
            calls.append("")
            return len(calls)

        keys = gateway.service.keys
        for wrong in ("x" * (MAX_KEY + 1), "\0", "a\nb"):
            with pytest.raises(Rejected):
                await keys.once("operate", wrong, [], do)
        assert await keys.once("operate", "first", [], do) == 1
        with gateway.store._transaction() as db:
            insert = "INSERT INTO keys (user, key, digest, answer) VALUES ('operate', ?, '', '')"
            db.executemany(insert, [(str(i),) for i in range(1999)])
        assert await keys.once("operate", "first", [], do) == 1
        await keys.once("view", "other", [], do)
        assert await keys.once("operate", "first", [], do) == 1
        await keys.once("operate", "newest", [], do)
        assert await keys.once("operate", "first", [], do) == 4

        async def refuse() -> None:
            raise Refused("no")

        for _ in range(2):
            with pytest.raises(Refused):
                await keys.once("operate", "refused", [], refuse)

    in_gateway(test)


def test_answer_to_a_question_is_not_kept_with_its_key(in_gateway: Run) -> None:
    async def test(gateway: Any) -> None:
        async with served(gateway.service) as address:
            for path, body in (("/api/world/query", {"query": "SELECT ?s {?s ?p ?o}"}), ("/api/plan", {"goal": "(x)"})):
                assert (await curl(address, path, *KEY, token=TOKEN, body=body))[0] == 200
                assert gateway.store.find_key("operate", "k") is None, "answers are large: viewers would fill the disk"

    in_gateway(test)
