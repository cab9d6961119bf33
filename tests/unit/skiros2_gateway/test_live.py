"""The live view: viewers that apply the patches have the document."""

from __future__ import annotations

import asyncio
import copy
import random
from typing import Any

import pytest

from skiros2_common.core.forward_clock import now
from skiros2_gateway.core.live import LiveView
from skiros2_gateway.core.patch import apply_patch, merge_patch
from skiros2_live.core.cell import CellDocument


def _random_object(rng: random.Random, depth: int = 0) -> dict[str, Any]:
    def value() -> Any:
        is_object = depth < 3 and rng.random() < 0.5
        return _random_object(rng, depth + 1) if is_object else rng.choice([1, 0.5, True, "text", [1, 2]])

    return {key: value() for key in rng.sample("abcdef", rng.randint(0, 5))}


def test_a_patch_makes_one_document_of_the_other() -> None:
    rng = random.Random(1)
    for _ in range(2000):
        before, after = _random_object(rng), _random_object(rng)
        apply_patch(before, merge_patch(before, after))
        assert before == after


@pytest.mark.parametrize("seed", range(3))
def test_a_viewer_has_the_document_after_any_changes(seed: int) -> None:
    asyncio.run(asyncio.wait_for(_follow_random_changes(random.Random(seed)), 30.0))


async def _follow_random_changes(rng: random.Random) -> None:
    view = LiveView(CellDocument())
    document = copy.deepcopy(view.snapshot()["document"])
    patches = view.stream.follow(view.stream.last_id)
    for _ in range(100):
        for _ in range(20):
            removed = rng.random() < 0.3
            view.put("elements", f"Part-{rng.randint(0, 9)}", None if removed else _random_object(rng))
        view.flush()
        view.put("cell", "mark", rng.random())  # the last change of this round, in a patch of its own
        view.flush()
        mark = view.entry("cell", "mark")
        while document["cell"].get("mark") != mark:
            apply_patch(document, (await anext(patches)).data)
        assert document == view.snapshot()["document"]


@pytest.mark.parametrize("days", [-1, 1])
def test_clock_that_is_set_by_a_day_loses_no_history(monkeypatch: pytest.MonkeyPatch, days: int) -> None:
    wall, elapsed = 1e9, 0.0
    monkeypatch.setattr(now, "_wall", lambda: wall + elapsed)
    monkeypatch.setattr(now, "_monotonic", lambda: elapsed)
    monkeypatch.setattr(now, "_last", 0.0)
    monkeypatch.setattr(now, "_at", 0.0)

    async def test() -> None:
        nonlocal wall, elapsed
        view, times = LiveView(CellDocument()), []
        for number in range(20):
            view.put("elements", "Part-1", {"number": number})
            times.append(view.snapshot()["time"])
            elapsed += 1.0
            if number == 9:
                wall += days * 86_400.0
        found = [view.scenes.at(time)["elements"]["Part-1"]["number"] for time in times]
        assert found == list(range(20))

    asyncio.run(test())
