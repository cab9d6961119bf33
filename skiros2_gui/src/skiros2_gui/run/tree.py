"""The drawn tree of a task: layout, folding, search and selection. Nodes are identified by id, which is kept when the
shape changes.
"""

from __future__ import annotations

import bisect
import itertools
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from skiros2_runs.core.frame import Frame, Shape
from skiros2_runs.core.states import FAILURE, RUNNING

#: The distance of two neighbouring leaves with the same parent, and with different parents.
SIBLINGS, COUSINS = 1.0, 1.25

#: A tree with more nodes is partly folded at first.
MAX_AT_FIRST = 1500


def pre_order(children: Sequence[Sequence[int]]) -> list[int]:
    """Returns the indices of the nodes below the first one, each before its children."""
    order: list[int] = []
    waiting = [0] if children else []
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(children[order[-1]]))
    return order


def layout(children: Sequence[Sequence[int]], order: Sequence[int]) -> list[float]:
    """Returns the row of each node: leaves are stacked in order, and each parent is centred over its children.

    :param order: the nodes in pre-order; others get row 0.
    """
    row = [0.0] * len(children)
    parent = {child: node for node in order for child in children[node]}
    leaves = [node for node in order if not children[node]]
    for above, leaf in itertools.pairwise(leaves):
        row[leaf] = row[above] + (SIBLINGS if parent[above] == parent[leaf] else COUSINS)
    for node in reversed(order):
        if children[node]:
            row[node] = (row[children[node][0]] + row[children[node][-1]]) / 2
    return row


@dataclass(frozen=True)
class Column:
    """The nodes of one depth, from top to bottom.

    :param nodes: their indices.
    :param rows: their positions; 1 is the height of a node with its gap.
    """

    nodes: Sequence[int]
    rows: Sequence[float]

    def between(self, top: float, bottom: float) -> range:
        """Returns the positions in `nodes` whose row is between two rows."""
        return range(bisect.bisect_left(self.rows, top), bisect.bisect_right(self.rows, bottom))


class Drawing:
    """Immutable. Takes time linear in the number of nodes.

    :param folded: the ids of nodes whose children are not drawn.
    :ivar drawn: the indices of the drawn nodes in pre-order.
    :ivar columns: by depth.
    :ivar row: of each node, by index; 0 for nodes that are not drawn.
    :ivar hidden: the number of descendants of each folded node, by index.
    """

    def __init__(self, shape: Shape, folded: Collection[int]) -> None:
        self.shape = shape
        self.children: list[Sequence[int]] = [
            () if children and shape.id(index) in folded else children for index, children in enumerate(shape.children)
        ]
        self.drawn = pre_order(self.children)
        self.row = layout(self.children, self.drawn)
        self._is_drawn = [False] * len(shape)
        levels: dict[int, list[int]] = {}
        for index in self.drawn:
            self._is_drawn[index] = True
            levels.setdefault(shape.depths[index], []).append(index)
        self.columns = [Column(levels[depth], [self.row[p] for p in levels[depth]]) for depth in sorted(levels)]
        below = [0] * len(shape)
        for index in range(len(shape) - 1, 0, -1):
            below[shape.parents[index]] += below[index] + 1
        self.hidden = {p: below[p] for p in self.drawn if shape.children[p] and not self.children[p]}

    @property
    def height(self) -> float:
        """The row of the lowest node."""
        return max((column.rows[-1] for column in self.columns), default=0.0)

    def is_drawn(self, index: int) -> bool:
        return self._is_drawn[index]

    def visible_node(self, index: int) -> int:
        """Returns the node, or its folded ancestor if it is not drawn."""
        return next(node for node in reversed(self.shape.path(index)) if self._is_drawn[node])


class RunTree:
    """Used in the window's thread.

    :ivar drawing: the current drawing; None before the first one.
    :ivar selected: the id of the selected node, or None.
    :ivar text: the search text.
    """

    def __init__(self) -> None:
        self.drawing: Drawing | None = None
        self.selected: int | None = None
        self.text = ""
        self._folded: set[int] = set()
        self._is_new = True
        self._found: tuple[Shape, list[str], list[int]] | None = None  # shape, words, indices

    @property
    def folded(self) -> frozenset[int]:
        return frozenset(self._folded)

    def show(self, shape: Shape) -> bool:
        """Draws the tree of a shape.

        :returns: whether the drawing has changed.
        """
        if self.drawing is not None and self.drawing.shape is shape:
            return False
        if self._is_new and len(shape) > MAX_AT_FIRST:
            self._fold_from(shape, _deepest_for(shape, MAX_AT_FIRST))
        self._is_new = self._is_new and len(shape) <= MAX_AT_FIRST
        self.drawing = Drawing(shape, self._folded)
        return True

    def toggle_fold(self, node: int) -> None:
        """Folds or unfolds a node."""
        self._change_folds(self._folded ^ {node})

    def unfold_all(self) -> None:
        self._change_folds(set())

    def fold_to(self, depth: int) -> None:
        """Folds the nodes at a depth and below; the root has depth 0."""
        if self.drawing is not None:
            self._fold_from(self.drawing.shape, depth)
            self._change_folds(self._folded)

    def fold_quiet(self, frame: Frame) -> None:
        """Folds nodes without running or failed descendants."""
        shape = frame.shape
        states = frame.rows["state"]
        is_busy = ((states == RUNNING) | (states == FAILURE)).tolist()
        for index in range(len(shape) - 1, 0, -1):
            if is_busy[index]:
                is_busy[shape.parents[index]] = True
        quiet = (p for p, children in enumerate(shape.children) if p and children and not is_busy[p])
        self._change_folds({shape.id(index) for index in quiet})

    def reveal(self, index: int) -> bool:
        """Unfolds the ancestors of a node.

        :returns: whether any was folded.
        """
        if self.drawing is None:
            return False
        above = {self.drawing.shape.id(p) for p in self.drawing.shape.path(index)[:-1]}
        if not above & self._folded:
            return False
        self._change_folds(self._folded - above)
        return True

    def selected_index(self) -> int | None:
        """Returns the index of the selected node; None if it is not in the tree."""
        if self.drawing is None or self.selected is None:
            return None
        return self.drawing.shape.index_by_id.get(self.selected)

    def found(self) -> list[int]:
        """Returns the indices of nodes that match the search text, in pre-order; folded ones too."""
        words = self.text.lower().split()
        if self.drawing is None or not words:
            return []
        if self._found is None or self._found[:2] != (self.drawing.shape, words):
            self._found = (self.drawing.shape, words, self._search(words))
        return self._found[2]

    def _search(self, words: list[str]) -> list[int]:
        assert self.drawing is not None
        shape = self.drawing.shape
        names = (f"{kind} {label} {processor}".lower() for _, _, kind, label, processor in shape.keys)
        found = {p for p, name in enumerate(names) if all(word in name for word in words)}
        return [p for p in pre_order(shape.children) if p in found] if found else []

    def next_of(self, indices: Iterable[int], step: int = 1) -> int | None:
        """Returns the node of `indices` that follows the selected one (-1: precedes it), cyclically; None if there is
        none.

        :param indices: in order.
        """
        indices = list(indices)
        if not indices:
            return None
        index = self.selected_index()
        if index in indices:
            return indices[(indices.index(index) + step) % len(indices)]
        return indices[0] if step > 0 else indices[-1]

    def neighbour(self, direction: str) -> int | None:
        """Returns the node that an arrow key leads to: `left` to the parent, `right` to a child, `up` and `down` in the
        column; or None.
        """
        drawing, index = self.drawing, self.selected_index()
        if drawing is None:
            return None
        if index is None or not drawing.is_drawn(index):
            return 0
        if direction == "left":
            return drawing.shape.parents[index] if index else None
        if direction == "right":
            children = drawing.children[index]
            return children[len(children) // 2] if children else None
        column = drawing.columns[drawing.shape.depths[index]].nodes
        number = column.index(index) + (1 if direction == "down" else -1)
        return column[number] if 0 <= number < len(column) else None

    def _fold_from(self, shape: Shape, depth: int) -> None:
        deep = (p for p, children in enumerate(shape.children) if children and shape.depths[p] >= depth)
        self._folded = {shape.id(index) for index in deep}

    def _change_folds(self, folded: set[int]) -> None:
        self._folded = folded
        if self.drawing is not None:
            self.drawing = Drawing(self.drawing.shape, folded)


def _deepest_for(shape: Shape, most: int) -> int:
    """Returns the largest depth with at most that many nodes; at least 1."""
    depths = sorted(shape.depths)
    return max(1, depths[most] - 1)
