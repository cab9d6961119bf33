"""Coordination of programs on one world model: optimistic locking, atomic requests, waiting."""

from __future__ import annotations

import threading
import time

import pytest

from skiros2_common.core.element_content import ElementChanges
from skiros2_common.core.operations import Add, Expect, Patch, Relate, Remove
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.wm_errors import WmConflict, WmException

SCENE = "skiros:Scene-0"


@pytest.fixture
def part(world):
    return world.add("skiros:Part", "part", State="new")


@pytest.fixture
def other(world):
    return world.connect("other")


# -- compare and set -----------------------------------------------------------------------------------------------


def test_unchanged_element_is_written(wm, part):
    mine = wm.get_element(part.id)
    mine.setProperty("skiros:State", "mine")
    assert wm.update_element_if_unchanged(mine) == part.id
    mine.setProperty("skiros:State", "mine again")
    wm.update_element_if_unchanged(mine)
    assert wm.get_element(part.id).value_of("skiros:State") == "mine again"


def test_write_of_an_outdated_element_is_refused_with_the_other_author(wm, other, part):
    mine, theirs = wm.get_element(part.id), other.get_element(part.id)
    theirs.setProperty("skiros:Weight", 2.0)
    other.update_element(theirs)
    mine.setProperty("skiros:State", "mine")
    with pytest.raises(WmConflict, match=f"{part.id} was changed by /?other") as refused:
        wm.update_element_if_unchanged(mine)
    assert isinstance(refused.value, WmException)
    now = other.get_element(part.id)
    assert (now.value_of("skiros:State"), now.value_of("skiros:Weight")) == ("new", 2.0)


def test_relation_by_another_client_makes_an_element_outdated(world, wm, other, part):
    mine = wm.get_element(part.id)
    box = world.add("skiros:LargeBox", "box")
    other.set_relation(part.id, "skiros:at", box.id)
    mine.setProperty("skiros:State", "mine")
    other.set_relation(box.id, "skiros:contain", part.id)
    with pytest.raises(WmConflict):
        wm.update_element_if_unchanged(mine)


def test_hand_made_element_cannot_be_compared(wm, part):
    by_hand = Element("skiros:Part", "part", part.id)
    with pytest.raises(WmException, match="was not read"):
        wm.update_element_if_unchanged(by_hand)


def test_one_of_several_concurrent_claims_succeeds(world, wm, part):
    clients = [world.connect(f"client_{i}") for i in range(4)]
    ready, winners, seen_by_others = threading.Barrier(len(clients)), [], []

    def take(client, name):
        mine = client.get_element(part.id)
        mine.setProperty("skiros:State", name)
        ready.wait(30.0)
        try:
            client.update_element_if_unchanged(mine)
        except WmConflict:
            seen_by_others.append(client.get_element(part.id).value_of("skiros:State"))
            return
        winners.append(name)

    threads = [threading.Thread(target=take, args=(c, str(i))) for i, c in enumerate(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
    assert len(winners) == 1
    assert seen_by_others == winners * (len(clients) - 1)


# -- several changes in one request --------------------------------------------------------------------------------


def test_elements_and_relations_are_changed_in_one_request(world, wm, part):
    box = world.add("skiros:LargeBox", "box")
    old = world.add("skiros:Part", "old")
    outcome = wm.transact(
        [
            Add(Element("skiros:Part", "new"), reference="new"),
            Relate(box.id, "skiros:contain", part.id),
            Patch(part.id, ElementChanges({"skiros:State": Property("skiros:State", "boxed")})),
            Remove(old.id),
        ]
    )
    assert wm.get_element(outcome.ids[0]).label == "new"
    assert wm.get_element(part.id).value_of("skiros:State") == "boxed"
    assert wm.get_relations(box.id, "skiros:contain", part.id)
    assert not wm.is_scene_element(old.id)


def test_request_with_one_wrong_part_is_refused(wm, other, part):
    version = wm.get_element(part.id).version
    changed = other.get_element(part.id)
    changed.setProperty("skiros:Weight", 1.0)
    other.update_element(changed)
    before = sorted(e.id for e in other.get_scene_elements())
    add, gone = Add(Element("skiros:Part", "new")), "skiros:Part-99999"
    for wrong in (Expect(part.id, version), Expect(gone, 0), Relate(part.id, "skiros:at", gone)):
        with pytest.raises(WmException):
            wm.transact([add, wrong])
    assert sorted(e.id for e in other.get_scene_elements()) == before


def test_expectation_without_change_changes_nothing(wm, part):
    version = wm.get_element(part.id).version
    assert wm.transact([Expect(part.id, version)]).changes == []
    assert wm.get_element(part.id).version >= part.version


# -- waiting -------------------------------------------------------------------------------------------------------


def test_wait_for_a_relation_that_holds_returns_at_once(wm, part):
    assert wm.wait_for_relation(SCENE, "skiros:contain", part.id, timeout=0.0)
    assert wm.wait_for_relation(part.id, "skiros:contain", SCENE, state=False, timeout=0.0)


def test_wait_ends_at_the_timeout(wm, part):
    assert not wm.wait_for_relation(part.id, "skiros:contain", SCENE, timeout=0.05)


def test_wait_ends_when_another_client_adds_the_relation(world, wm, other, part):
    box = world.add("skiros:LargeBox", "box")
    answers = []
    waiting = threading.Thread(
        target=lambda: answers.append(
            wm.wait_for_relation(Element("skiros:LargeBox"), "skiros:spatiallyRelated", part.id, timeout=60.0)
        )
    )
    waiting.start()
    other.set_relation(box.id, "skiros:contain", part.id)
    waiting.join(60.0)
    assert answers == [True]


def test_wait_ends_when_a_property_has_the_value(wm, other, part):
    answers = []
    waiting = threading.Thread(
        target=lambda: answers.append(
            wm.wait_until(lambda: wm.get_element(part.id).value_of("skiros:State") == "done", timeout=60.0)
        )
    )
    waiting.start()
    for state in ("started", "done"):
        theirs = other.get_element(part.id)
        theirs.setProperty("skiros:State", state)
        other.update_element(theirs)
    waiting.join(60.0)
    assert answers == [True]


def test_wait_removes_its_listener(wm, part):
    calls = []

    def check():
        calls.append(time.monotonic())
        return False

    assert not wm.wait_until(check, timeout=0.01)
    seen = len(calls)
    wm.set_relation(SCENE, "skiros:hasA", part.id)
    assert len(calls) == seen


def test_timeout_that_is_no_number_is_refused(wm):
    with pytest.raises(ValueError, match="not a number"):
        wm.wait_until(lambda: False, timeout=float("nan"))
