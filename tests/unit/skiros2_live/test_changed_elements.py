"""Which elements have changed since a view has read them."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.operations import ADD, REMOVE, RESET, UPDATE, Change
from skiros2_common.core.world_element import Element
from skiros2_live.core.changed_elements import ChangedElements
from skiros2_world_model.core.wm_errors import WmException


def element(eid: str = "skiros:Product-7") -> Element:
    return Element("skiros:Product", "Bolt", eid)


def change(number: int, action: str, *elements: Element, before: int | None = None, context: str = "scene") -> Change:
    previous = number - 1 if before is None else before
    return Change(number, f"s-{previous}", f"s-{number}", 0.0, "me", action, context, elements)


def test_changed_elements_collect_ids() -> None:
    changed = ChangedElements()
    assert changed.take() is None, "at first, everything is new"
    for number, action in enumerate((ADD, UPDATE, REMOVE), 1):
        changed.add(change(number, action, element(f"skiros:Product-{number % 2}")))
    changed.add(change(4, UPDATE, element("skiros:Product-9"), context="other"))
    assert changed.waiting.is_set() and changed.take() == {"skiros:Product-0", "skiros:Product-1"}
    assert not changed.waiting.is_set() and changed.take() == set()


@pytest.mark.parametrize(
    "then", [change(2, RESET), change(5, UPDATE, element()), change(2, UPDATE)], ids=["reset", "gap", "ontology"]
)
def test_reset_gap_or_ontology_change_counts_as_everything(then: Change) -> None:
    changed = ChangedElements()
    changed.take()
    changed.add(change(1, ADD, element()))
    changed.add(then)
    assert changed.take() is None


def test_elements_that_could_not_be_shown_count_as_changed_again() -> None:
    changed = ChangedElements()
    world: Any = _World()
    for ids in ([], ["skiros:Product-7", "skiros:Product-8"]):
        changed.add_ids(ids)
        with pytest.raises(WmException), changed.read(world) as read:
            raise WmException("the world model does not answer")
        with changed.read(world) as again:
            assert again[0].keys() == read[0].keys() == {"skiros:Product-7", *ids}
        assert [eid for eid, found in again[0].items() if found is None] == ids[1:]
        assert again[1] == (not ids)
    assert not changed.waiting.is_set()


class _World:
    """A scene of one element."""

    def resolve_elements(self, _: Element) -> list[Element]:
        return [element()]

    def find_element(self, eid: str) -> Element | None:
        return element() if eid == element().id else None
