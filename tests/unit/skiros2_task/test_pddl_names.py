"""PDDL names."""

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
def test_pddl_name_is_valid(text: str, name: str) -> None:
    assert pddl_name(text) == name


def test_equal_names_are_numbered() -> None:
    naming = Naming()
    names = [naming.name(thing, [thing]) for thing in ("Pick it", "pick_it", "PICK IT")]
    assert names == ["pick_it", "pick_it_2", "pick_it_3"]
    assert [naming.key(name) for name in names] == ["Pick it", "pick_it", "PICK IT"]
    assert naming.key("PICK_IT_2") == "pick_it"


def test_key_keeps_its_name() -> None:
    naming = Naming()
    assert naming.name(1, ["a"]) == naming.name(1, ["b"]) == "a"


def test_first_free_candidate_is_chosen() -> None:
    naming = Naming()
    naming.name(1, ["idle"])
    assert naming.name(2, ["idle", "camera_idle"]) == "camera_idle"


def test_reserved_words_are_not_chosen() -> None:
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
def test_find_ignores_prefix_and_case(index: NameIndex, text: str, found: list[str]) -> None:
    assert index.find(text) == found


def test_near_matches_returns_similar_names(index: NameIndex) -> None:
    assert index.near_matches("skiros:contains")[0] == "skiros:contain"
    assert index.near_matches("contians") != []
    assert index.near_matches("zzzz") == []
