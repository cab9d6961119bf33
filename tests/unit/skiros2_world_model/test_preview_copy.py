"""A preview copy and its world model do not see each other's changes."""

from __future__ import annotations

from typing import Any

import pytest

from skiros2_common.core.operations import REMOVE, UPDATE
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.preview_copy import PreviewCopy
from skiros2_world_model.core.wm_errors import WmException

ROOT = "skiros:Scene-0"


@pytest.fixture
def wm() -> LocalWorldModel:
    return LocalWorldModel()


def add(wm: Any, cls: str, inside: str = ROOT) -> str:
    element = Element(cls)
    element.addRelation(inside, "skiros:contain", "-1")
    return str(wm.add_element(element).id)


def test_it_begins_as_the_scene_is(wm: LocalWorldModel) -> None:
    place = add(wm, "skiros:Location")
    product = add(wm, "skiros:Product", place)
    copy = PreviewCopy(wm)
    assert {e.id for e in copy.resolve_elements(Element())} == {ROOT, place, product}
    assert [e.id for e in copy.get_branch(ROOT)] == [e.id for e in wm.get_branch(ROOT)]
    assert copy.check_relation(place, "skiros:contain", product, True, False)
    assert copy.is_subclass("skiros:Product", "sumo:Object")
    assert copy.get_sub_classes("sumo:Object") == wm.get_sub_classes("sumo:Object")


def test_changes_of_one_are_not_seen_by_the_other(wm: LocalWorldModel) -> None:
    place, other = add(wm, "skiros:Location"), add(wm, "skiros:Location")
    product = add(wm, "skiros:Product", place)
    copy = PreviewCopy(wm)
    copy.set_relation(place, "skiros:contain", product, False)
    copy.set_relation(other, "skiros:contain", product, True)
    element = copy.get_element(product)
    element.setProperty("skiros:Weight", 2.0)
    copy.update_element(element)
    new = add(copy, "skiros:Product", other)
    assert copy.get_element(product).value_of("skiros:Weight") == 2.0
    assert {e.id for e in copy.get_branch(other)} == {other, product, new}
    assert {e.id for e in wm.get_branch(place)} == {place, product}
    assert wm.get_element(product).value_of("skiros:Weight") is None
    assert add(wm, "skiros:Product") == new  # nobody has heard of the copy's
    wm.remove_element(wm.get_element(product))
    assert copy.find_element(product) is not None


def test_listeners_get_changed_and_removed_elements(wm: LocalWorldModel) -> None:
    place = add(wm, "skiros:Location")
    product = add(wm, "skiros:Product", place)
    copy = PreviewCopy(wm)
    heard: list[tuple[str, set[str]]] = []

    def listen(change: Any) -> None:
        heard.append((change.action, {e.id for e in change.elements}))

    copy.add_listener(listen)
    before = copy.version
    copy.remove_element(copy.get_element(product))
    assert (REMOVE, {product}) in heard
    assert all(place in ids for action, ids in heard if action == UPDATE)
    assert copy.version != before
    heard.clear()
    copy.remove_listener(listen)
    add(copy, "skiros:Product")
    assert heard == []


def test_copy_refuses_requests_as_the_world_model_does(wm: LocalWorldModel) -> None:
    place = add(wm, "skiros:Location")
    copy = PreviewCopy(wm)
    before = copy.version
    with pytest.raises(WmException, match="skiros:Product-99"):
        copy.set_relation(place, "skiros:contain", "skiros:Product-99", True)
    assert copy.version == before
    assert copy.get_relations(place, "skiros:contain", "") == []


def test_it_has_no_files_and_no_ontologies_of_its_own(wm: LocalWorldModel) -> None:
    copy = PreviewCopy(wm)
    for refused in (
        lambda: copy.load("scene.ttl"),
        lambda: copy.save("scene.ttl"),
        lambda: copy.add_class("skiros:New", "sumo:Object"),
        lambda: copy.query_ontology("SELECT ?x WHERE { ?x ?y ?z }", context="scene"),
    ):
        with pytest.raises(WmException, match="a copy of a scene"):
            refused()
