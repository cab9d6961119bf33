"""PDDL types of ontology classes."""

from __future__ import annotations

from skiros2_task.core.up_model import TypeTree

EVERYTHING = "*"


def test_nested_classes_become_nested_types() -> None:
    tree = TypeTree({EVERYTHING: "abcd", "Object": "abcd", "Product": "ab", "Place": "c"})
    assert tree.parent == {"Object": EVERYTHING, "Product": "Object", "Place": "Object"}
    assert tree.type_of == {"a": "Product", "b": "Product", "c": "Place", "d": "Object"}
    assert tree.crossing == []


def test_equal_classes_nest_in_order() -> None:
    tree = TypeTree({EVERYTHING: "ab", "Artifact": "a", "Product": "a"})
    assert tree.parent == {"Artifact": EVERYTHING, "Product": "Artifact"}


def test_crossing_class_is_not_a_type() -> None:
    tree = TypeTree({EVERYTHING: "abc", "Agent": "ab", "Device": "bc"})
    assert tree.parent == {"Agent": EVERYTHING}
    assert tree.crossing == ["Device"]


def test_smallest_and_join() -> None:
    tree = TypeTree({EVERYTHING: "abcd", "Object": "abc", "Product": "ab", "Place": "c"})
    assert tree.smallest("a") == "Product"
    assert tree.smallest("ac") == "Object"
    assert tree.smallest("ad") == EVERYTHING
    assert tree.join("Product", "Place") == "Object"
    assert tree.join("Product", "Object") == "Object"
    assert tree.join("Product", EVERYTHING) == EVERYTHING
