"""A tree as it is drawn: which nodes, in which column and row, with which lines between them."""

from __future__ import annotations

import bisect
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from skiros2_gui.core.run_shape import Shape
from skiros2_gui.core.tree_layout import tidy


@dataclass(frozen=True)
class Column:
    """The nodes of one depth, from the top down.

    :param rows: how far down each is; 1 is the height of a node with its gap.
    """

    places: Sequence[int]
    rows: Sequence[float]

    def between(self, top: float, bottom: float) -> range:
        """The numbers of the nodes whose middle is between two rows."""
        return range(bisect.bisect_left(self.rows, top), bisect.bisect_right(self.rows, bottom))


class Drawing:
    """Not changed once made. Takes time linear in the number of nodes; any thread.

    :param folded: the ids of nodes whose children are not drawn.
    :ivar columns: by depth.
    :ivar row: of each node, by its place; of those that are not drawn, 0.
    :ivar hidden: of each folded node that is drawn, how many nodes are under it.
    """

    def __init__(self, shape: Shape, folded: Collection[int]) -> None:
        self.shape = shape
        self.children: list[Sequence[int]] = [
            () if children and shape.id(place) in folded else children for place, children in enumerate(shape.children)
        ]
        self.row = tidy(self.children)
        self.drawn = self._find_drawn()
        self.hidden = self._count_hidden()
        self.columns = self._make_columns()

    @property
    def height(self) -> float:
        """The row of the lowest node."""
        return max((column.rows[-1] for column in self.columns), default=0.0)

    def is_drawn(self, place: int) -> bool:
        return self._is_drawn[place]

    def shown_for(self, place: int) -> int:
        """The node itself, or the folded one that stands for it."""
        return next(above for above in reversed(self.shape.path(place)) if self._is_drawn[above])

    def _find_drawn(self) -> list[int]:
        """The places of the nodes that are drawn, each before its children, from the top down."""
        self._is_drawn = [False] * len(self.shape)
        drawn: list[int] = []
        waiting = [0] if len(self.shape) else []
        while waiting:
            place = waiting.pop()
            self._is_drawn[place] = True
            drawn.append(place)
            waiting.extend(reversed(self.children[place]))
        return drawn

    def _count_hidden(self) -> dict[int, int]:
        below = [0] * len(self.shape)
        for place in range(len(self.shape) - 1, 0, -1):
            below[self.shape.parents[place]] += below[place] + 1
        return {p: below[p] for p in self.drawn if self.shape.children[p] and not self.children[p]}

    def _make_columns(self) -> list[Column]:
        levels: list[list[int]] = []
        for place in self.drawn:
            depth = self.shape.depths[place]
            while len(levels) <= depth:
                levels.append([])
            levels[depth].append(place)
        return [Column(level, [self.row[p] for p in level]) for level in levels]
