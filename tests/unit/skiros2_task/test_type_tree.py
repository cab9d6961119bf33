"""Classes as PDDL types."""

from __future__ import annotations

from skiros2_task.core.type_tree import TypeTree

EVERYTHING = "*"


def test_nested_classes_become_types_under_each_other() -> None:
    tree = TypeTree({EVERYTHING: "abcd", "Object": "abcd", "Product": "ab", "Place": "c"})
    assert tree.parent == {"Object": EVERYTHING, "Product": "Object", "Place": "Object"}
    assert tree.type_of == {"a": "Product", "b": "Product", "c": "Place", "d": "Object"}
    assert tree.crossing == []


def test_of_classes_with_the_same_objects_the_later_stands_under_the_earlier() -> None:
    tree = TypeTree({EVERYTHING: "ab", "Artifact": "a", "Product": "a"})
    assert tree.parent == {"Artifact": EVERYTHING, "Product": "Artifact"}


def test_a_class_that_crosses_another_is_no_type() -> None:
    tree = TypeTree({EVERYTHING: "abc", "Agent": "ab", "Device": "bc"})
    assert tree.parent == {"Agent": EVERYTHING}
    assert tree.crossing == ["Device"]


def test_the_smallest_type_of_some_objects_and_the_join_of_two_types() -> None:
    tree = TypeTree({EVERYTHING: "abcd", "Object": "abc", "Product": "ab", "Place": "c"})
    assert tree.smallest("a") == "Product"
    assert tree.smallest("ac") == "Object"
    assert tree.smallest("ad") == EVERYTHING
    assert tree.join("Product", "Place") == "Object"
    assert tree.join("Product", "Object") == "Object"
    assert tree.join("Product", EVERYTHING) == EVERYTHING
