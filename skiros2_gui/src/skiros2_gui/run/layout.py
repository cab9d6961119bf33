"""Tidy tree layout: nodes do not overlap, and each parent is centred over its children.

Algorithm: C. Buchheim, M. Jünger, S. Leipert, *Improving Walker's Algorithm to Run in Linear Time*, Graph Drawing 2002;
without recursion, so that trees may have any depth.
"""

from __future__ import annotations

from collections.abc import Sequence

#: The least distance of two siblings, and of two neighbours with different parents.
SIBLINGS, COUSINS = 1.0, 1.25


class _Walk:
    """The state of the algorithm; names as in the paper."""

    def __init__(self, children: Sequence[Sequence[int]], root: int) -> None:
        self.children = children
        self.order: list[int] = []  # each before its children
        count = len(children)
        self.parent = [-1] * count
        self.number = [0] * count
        self.prelim = [0.0] * count
        self.mod = [0.0] * count
        self.thread = [-1] * count
        self.ancestor = list(range(count))
        self.change = [0.0] * count
        self.shift = [0.0] * count
        stack = [root]
        while stack:
            node = stack.pop()
            self.order.append(node)
            for number, child in enumerate(children[node]):
                self.parent[child] = node
                self.number[child] = number
            stack.extend(reversed(children[node]))

    def first(self) -> None:
        """Computes positions relative to the siblings and moves subtrees apart."""
        default: dict[int, int] = {}  # of each parent, the default ancestor
        for node in self._post_order():
            siblings = self.children[self.parent[node]] if self.parent[node] >= 0 else [node]
            left = siblings[self.number[node] - 1] if self.number[node] else -1
            below = self.children[node]
            if below:
                self._execute_shifts(node)
                middle = (self.prelim[below[0]] + self.prelim[below[-1]]) / 2
                if left >= 0:
                    self.prelim[node] = self.prelim[left] + SIBLINGS
                    self.mod[node] = self.prelim[node] - middle
                else:
                    self.prelim[node] = middle
            else:
                self.prelim[node] = self.prelim[left] + SIBLINGS if left >= 0 else 0.0
            above = self.parent[node]
            if above >= 0:
                default[above] = self._apportion(node, left, default.get(above, siblings[0]))

    def second(self) -> list[float]:
        """Returns the positions; 0 for nodes that are not below the root."""
        result = [0.0] * len(self.children)
        moved = [0.0] * len(self.children)
        for node in self.order:
            above = self.parent[node]
            if above >= 0:
                moved[node] = moved[above] + self.mod[above]
            result[node] = self.prelim[node] + moved[node]
        return result

    def _post_order(self) -> list[int]:
        """Returns each node after its children and its left siblings."""
        result: list[int] = []
        stack = [self.order[0]]
        while stack:
            node = stack.pop()
            result.append(node)
            stack.extend(self.children[node])
        return result[::-1]

    def _apportion(self, node: int, left: int, default: int) -> int:
        """Moves the subtree of a node away from those on its left."""
        if left < 0:
            return default
        siblings = self.children[self.parent[node]]
        inner_right = outer_right = node
        inner_left, outer_left = left, siblings[0]
        s_inner_right = s_outer_right = self.mod[node]
        s_inner_left, s_outer_left = self.mod[inner_left], self.mod[outer_left]
        while (next_left := self._right(inner_left)) >= 0 and (next_right := self._left(inner_right)) >= 0:
            inner_left, inner_right = next_left, next_right
            outer_left, outer_right = self._left(outer_left), self._right(outer_right)
            self.ancestor[outer_right] = node
            gap = SIBLINGS if self.parent[inner_left] == self.parent[inner_right] else COUSINS
            shift = (self.prelim[inner_left] + s_inner_left) - (self.prelim[inner_right] + s_inner_right) + gap
            if shift > 0:
                above = self.ancestor[inner_left]
                if self.parent[above] != self.parent[node]:
                    above = default
                self._move(above, node, shift)
                s_inner_right += shift
                s_outer_right += shift
            s_inner_left += self.mod[inner_left]
            s_inner_right += self.mod[inner_right]
            s_outer_left += self.mod[outer_left]
            s_outer_right += self.mod[outer_right]
        if self._right(inner_left) >= 0 and self._right(outer_right) < 0:
            self.thread[outer_right] = self._right(inner_left)
            self.mod[outer_right] += s_inner_left - s_outer_right
        if self._left(inner_right) >= 0 and self._left(outer_left) < 0:
            self.thread[outer_left] = self._left(inner_right)
            self.mod[outer_left] += s_inner_right - s_outer_left
            return node
        return default

    def _left(self, node: int) -> int:
        """Returns the next node on the left contour, or -1."""
        return self.children[node][0] if self.children[node] else self.thread[node]

    def _right(self, node: int) -> int:
        return self.children[node][-1] if self.children[node] else self.thread[node]

    def _move(self, left: int, right: int, shift: float) -> None:
        subtrees = self.number[right] - self.number[left]
        self.change[right] -= shift / subtrees
        self.shift[right] += shift
        self.change[left] += shift / subtrees
        self.prelim[right] += shift
        self.mod[right] += shift

    def _execute_shifts(self, node: int) -> None:
        shift = change = 0.0
        for child in reversed(self.children[node]):
            self.prelim[child] += shift
            self.mod[child] += shift
            change += self.change[child]
            shift += self.shift[child] + change


def tidy_layout(children: Sequence[Sequence[int]], root: int = 0) -> list[float]:
    """Returns the position of each node across the depth axis, starting at 0. Takes linear time.

    Nodes of one depth keep their order, with a distance of at least `SIBLINGS`, or `COUSINS` if their parents differ.

    :param children: of each node, in order; nodes that are not below the root are ignored.
    """
    if not children:
        return []
    walk = _Walk(children, root)
    walk.first()
    positions = walk.second()
    least = min(positions[node] for node in walk.order)
    for node in walk.order:
        positions[node] -= least
    return positions
