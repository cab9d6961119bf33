"""The layout of trees."""

from __future__ import annotations

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st

from skiros2_gui.run.tree import COUSINS, SIBLINGS, Drawing, layout, pre_order
from skiros2_runs.core.frame import Shape
from support.fuzz import examples
from support.progress import ProgressNode, pick_and_place, random_tree, root

#: Types and processors.
UNNAMED = [("skiros:Pick", "->*"), (":Skill", "->*"), (":Skill", "|ff|"), (":Skill", "nofail(->)"), (":Skill", "")]

#: Of each node after the first, how far before it its parent is.
trees = st.lists(st.integers(1, 12), max_size=60)


def children_of(steps: list[int]) -> list[list[int]]:
    children: list[list[int]] = [[] for _ in range(len(steps) + 1)]
    for number, step in enumerate(steps, 1):
        children[max(0, number - step)].append(number)
    return children


@settings(max_examples=examples(60))
@given(trees)
def test_layout_keeps_order_and_distance_and_centres_parents(steps: list[int]) -> None:
    children = children_of(steps)
    row = layout(children, pre_order(children))
    assert min(row) == 0.0
    level, parent = [0], {0: -1}
    while level:
        for one, next_one in itertools.pairwise(level):
            gap = SIBLINGS if parent[one] == parent[next_one] else COUSINS
            assert row[next_one] - row[one] >= gap - 1e-9
        for node in level:
            if children[node]:
                first, last = children[node][0], children[node][-1]
                assert abs(row[node] - (row[first] + row[last]) / 2) < 1e-9
        parent.update((child, node) for node in level for child in children[node])
        level = [child for node in level for child in children[node]]


def test_long_chain_is_a_line() -> None:
    chain = [[number + 1] for number in range(5000)] + [[]]
    assert layout(chain, pre_order(chain)) == [0.0] * 5001


def test_empty_tree_has_empty_layout() -> None:
    assert layout([], []) == []
    assert Drawing(Shape([]), ()).drawn == []


def test_descendants_of_folded_node_are_counted() -> None:
    shape = Shape.of(pick_and_place())
    drawing = Drawing(shape, {100})
    assert [shape.name(place) for place in drawing.drawn] == ["task 5", "pick", "place"]
    assert drawing.hidden == {1: 2}
    assert drawing.visible_node(shape.index_by_id[102]) == shape.index_by_id[100]
    assert [list(column.nodes) for column in drawing.columns] == [[0], [1, 4]]


def test_every_node_is_drawn_once_and_found_by_row() -> None:
    drawing = Drawing(Shape.of(random_tree(1000)), ())
    assert sorted(drawing.drawn) == list(range(1000))
    for column in drawing.columns:
        for place in column.nodes:
            row = drawing.row[place]
            assert place in [column.nodes[n] for n in column.between(row - 0.4, row + 0.4)]


def test_any_message_gives_a_tree() -> None:
    """Parents that do not exist, that come later, or that are the node itself; ids that come twice; no labels."""
    nodes = [ProgressNode(*ids) for ids in ((5, -1), (1, 99), (2, 3), (3, 3), (3, 1))]
    nodes.append(ProgressNode(4, 3, label="", type=""))
    shape = Shape.of(nodes)
    assert shape.parents == [-1, 0, 0, 0, 1, 4]
    assert sorted(Drawing(shape, ()).drawn) == list(range(6))
    assert shape.name(5) == "node 4"


def test_nodes_without_label_have_names() -> None:
    message = [root(7), *(ProgressNode(n, 7, "", kind, how) for n, (kind, how) in enumerate(UNNAMED))]
    shape = Shape.of(message)
    assert [shape.name(place) for place in range(len(shape))] == [
        "task 7", "Pick", "sequence ->*", "parallel |ff|", "nofail(->)", ":Skill",
    ]  # fmt: skip
    assert [shape.is_skill(place) for place in range(len(shape))] == [False, True, False, False, False, False]
