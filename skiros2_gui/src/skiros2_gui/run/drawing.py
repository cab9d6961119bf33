"""The layout of a tree with folded nodes: columns and rows."""

from __future__ import annotations

import bisect
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from skiros2_gui.run.layout import tidy_layout
from skiros2_runs.core.frame import Shape


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
    """Immutable. Takes time linear in the number of nodes; any thread.

    :param folded: the ids of nodes whose children are not drawn.
    :ivar columns: by depth.
    :ivar row: of each node, by index; 0 for nodes that are not drawn.
    :ivar hidden: the number of descendants of each folded node, by index.
    """

    def __init__(self, shape: Shape, folded: Collection[int]) -> None:
        self.shape = shape
        self.children: list[Sequence[int]] = [
            () if children and shape.id(index) in folded else children for index, children in enumerate(shape.children)
        ]
        self.row = tidy_layout(self.children)
        self.drawn = self._find_drawn()
        self.hidden = self._count_hidden()
        self.columns = self._make_columns()

    @property
    def height(self) -> float:
        """The row of the lowest node."""
        return max((column.rows[-1] for column in self.columns), default=0.0)

    def is_drawn(self, index: int) -> bool:
        return self._is_drawn[index]

    def visible_node(self, index: int) -> int:
        """Returns the node, or its folded ancestor if it is not drawn."""
        return next(node for node in reversed(self.shape.path(index)) if self._is_drawn[node])

    def _find_drawn(self) -> list[int]:
        """Returns the indices of the drawn nodes in pre-order."""
        self._is_drawn = [False] * len(self.shape)
        drawn: list[int] = []
        waiting = [0] if len(self.shape) else []
        while waiting:
            index = waiting.pop()
            self._is_drawn[index] = True
            drawn.append(index)
            waiting.extend(reversed(self.children[index]))
        return drawn

    def _count_hidden(self) -> dict[int, int]:
        below = [0] * len(self.shape)
        for index in range(len(self.shape) - 1, 0, -1):
            below[self.shape.parents[index]] += below[index] + 1
        return {p: below[p] for p in self.drawn if self.shape.children[p] and not self.children[p]}

    def _make_columns(self) -> list[Column]:
        levels: list[list[int]] = []
        for index in self.drawn:
            depth = self.shape.depths[index]
            while len(levels) <= depth:
                levels.append([])
            levels[depth].append(index)
        return [Column(level, [self.row[p] for p in level]) for level in levels]
