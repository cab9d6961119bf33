"""What the user does with a drawn tree: folding, searching, selecting. Of nodes the ids are kept, which stay when the
tree gets another shape."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_gui.core.run_drawing import Drawing
from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.run_shape import Shape
from skiros2_gui.core.states import FAILURE, RUNNING

#: Of a tree with more nodes, only the upper ones are unfolded at first.
MOST_AT_FIRST = 1500


class RunTree:
    """Used in the window's thread.

    :ivar drawing: the tree as it is drawn; None before there was one.
    :ivar selected: the id of the selected node; None: none is.
    :ivar text: what is searched for.
    """

    def __init__(self) -> None:
        self.drawing: Drawing | None = None
        self.selected: int | None = None
        self.text = ""
        self._folded: set[int] = set()
        self._is_new = True
        self._found: tuple[Shape, list[str], list[int]] | None = None  # of which tree, for what, which

    @property
    def folded(self) -> frozenset[int]:
        return frozenset(self._folded)

    def show(self, shape: Shape) -> bool:
        """Draws the tree of that shape.

        :returns: whether it is another drawing now.
        """
        if self.drawing is not None and self.drawing.shape is shape:
            return False
        if self._is_new and len(shape) > MOST_AT_FIRST:
            self._fold_from(shape, _deepest_for(shape, MOST_AT_FIRST))
        self._is_new = self._is_new and len(shape) <= MOST_AT_FIRST
        self.drawing = Drawing(shape, self._folded)
        return True

    def toggle_fold(self, node: int) -> None:
        """Folds a node, or unfolds it."""
        self._change_folds(self._folded ^ {node})

    def unfold_all(self) -> None:
        self._change_folds(set())

    def fold_to(self, depth: int) -> None:
        """Draws the nodes down to that depth (the root has 0)."""
        if self.drawing is not None:
            self._fold_from(self.drawing.shape, depth)
            self._change_folds(self._folded)

    def fold_quiet(self, frame: Frame) -> None:
        """Folds everything in which nothing runs and nothing has failed."""
        shape = frame.shape
        states = frame.rows["state"]
        is_busy = ((states == RUNNING) | (states == FAILURE)).tolist()
        for place in range(len(shape) - 1, 0, -1):
            if is_busy[place]:
                is_busy[shape.parents[place]] = True
        quiet = (p for p, children in enumerate(shape.children) if p and children and not is_busy[p])
        self._change_folds({shape.id(place) for place in quiet})

    def reveal(self, place: int) -> bool:
        """Unfolds what a node lies in.

        :returns: whether something was folded.
        """
        if self.drawing is None:
            return False
        above = {self.drawing.shape.id(p) for p in self.drawing.shape.path(place)[:-1]}
        if not above & self._folded:
            return False
        self._change_folds(self._folded - above)
        return True

    def place(self) -> int | None:
        """The place of the selected node; None: it is not in this tree."""
        if self.drawing is None or self.selected is None:
            return None
        return self.drawing.shape.places.get(self.selected)

    def found(self) -> list[int]:
        """The places of the nodes with the text in their label or type, from the top down, folded ones too."""
        words = self.text.lower().split()
        if self.drawing is None or not words:
            return []
        if self._found is None or self._found[:2] != (self.drawing.shape, words):
            self._found = (self.drawing.shape, words, self._search(words))
        return self._found[2]

    def _search(self, words: list[str]) -> list[int]:
        assert self.drawing is not None
        keys = self.drawing.shape.keys
        names = (f"{kind} {label} {processor}".lower() for _, _, kind, label, processor in keys)
        return _in_order(self.drawing.shape, [p for p, name in enumerate(names) if all(w in name for w in words)])

    def next_of(self, places: Iterable[int], step: int = 1) -> int | None:
        """Of some nodes the one after the selected one (or before it), beginning anew at the end; None: there is none.

        :param places: in order.
        """
        places = list(places)
        if not places:
            return None
        place = self.place()
        if place in places:
            return places[(places.index(place) + step) % len(places)]
        return places[0] if step > 0 else places[-1]

    def neighbour(self, direction: str) -> int | None:
        """The place of the node that an arrow key leads to from the selected one: `left` to the parent, `right` to the
        first child, `up` and `down` within the column; None: there is none."""
        drawing, place = self.drawing, self.place()
        if drawing is None:
            return None
        if place is None or not drawing.is_drawn(place):
            return 0
        if direction == "left":
            return drawing.shape.parents[place] if place else None
        if direction == "right":
            children = drawing.children[place]
            return children[len(children) // 2] if children else None
        column = drawing.columns[drawing.shape.depths[place]].places
        number = column.index(place) + (1 if direction == "down" else -1)
        return column[number] if 0 <= number < len(column) else None

    def _fold_from(self, shape: Shape, depth: int) -> None:
        deep = (p for p, children in enumerate(shape.children) if children and shape.depths[p] >= depth)
        self._folded = {shape.id(place) for place in deep}

    def _change_folds(self, folded: set[int]) -> None:
        self._folded = folded
        if self.drawing is not None:
            self.drawing = Drawing(self.drawing.shape, folded)


def _deepest_for(shape: Shape, most: int) -> int:
    """The depth down to which there are so many nodes at most; 1 at least."""
    counts = [0] * (max(shape.depths) + 1)
    for depth in shape.depths:
        counts[depth] += 1
    total, depth = 0, 0
    while depth < len(counts) and total + counts[depth] <= most:
        total += counts[depth]
        depth += 1
    return max(1, depth - 1)


def _in_order(shape: Shape, places: list[int]) -> list[int]:
    """As they stand in the tree, each before its children: a message may hold them in another order."""
    if len(places) < 2:
        return places
    wanted, waiting, ordered = set(places), [0], []
    while waiting:
        place = waiting.pop()
        if place in wanted:
            ordered.append(place)
        waiting.extend(reversed(shape.children[place]))
    return ordered
