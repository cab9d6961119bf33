"""Names as PDDL has them."""

from __future__ import annotations

import pytest

from skiros2_task.core.pddl_names import NameIndex, Naming, pddl_name


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("skiros:Product-12", "skiros_product-12"),
        ("Half Full", "half_full"),
        ("a/b", "a_b"),
        ("3rd", "n3rd"),
        ("Größe", "gr__e"),
        ("", "n"),
    ],
)
def test_a_name_has_only_what_pddl_allows(text: str, name: str) -> None:
    assert pddl_name(text) == name


def test_names_that_become_equal_are_kept_apart_and_lead_back() -> None:
    naming = Naming()
    names = [naming.name(thing, [thing]) for thing in ("Pick it", "pick_it", "PICK IT")]
    assert names == ["pick_it", "pick_it_2", "pick_it_3"]
    assert [naming.thing(name) for name in names] == ["Pick it", "pick_it", "PICK IT"]
    assert naming.thing("PICK_IT_2") == "pick_it"


def test_a_thing_keeps_its_name() -> None:
    naming = Naming()
    assert naming.name(1, ["a"]) == naming.name(1, ["b"]) == "a"


def test_the_first_free_wish_is_taken() -> None:
    naming = Naming()
    naming.name(1, ["idle"])
    assert naming.name(2, ["idle", "camera_idle"]) == "camera_idle"


def test_words_of_pddl_are_not_taken() -> None:
    assert Naming().name(1, ["Object"]) == "object_"
    assert Naming().name(1, ["not"]) == "not_"


@pytest.fixture
def index() -> NameIndex:
    index = NameIndex()
    for name in ("skiros:contain", "skiros:at", "sumo:at", "skiros:hasA"):
        index.add_prefixed(name)
    return index


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("skiros:contain", ["skiros:contain"]),
        ("contain", ["skiros:contain"]),
        (":contain", ["skiros:contain"]),
        ("CONTAIN", ["skiros:contain"]),
        ("skiros_hasa", ["skiros:hasA"]),
        ("at", ["skiros:at"]),
        ("sumo:at", ["sumo:at"]),
        ("contains", []),
    ],
)
def test_a_name_is_found_without_its_prefix_and_in_any_case(index: NameIndex, text: str, found: list[str]) -> None:
    assert index.find(text) == found


def test_names_that_look_alike_are_proposed(index: NameIndex) -> None:
    assert index.near("skiros:contains")[0] == "skiros:contain"
    assert index.near("contians") != []
    assert index.near("zzzz") == []
