"""A drawn tree as one graphics item: of however many nodes, only those that are in sight are painted."""

from __future__ import annotations

import bisect
import heapq
import math
from collections.abc import Collection, Iterator

import numpy as np
from python_qt_binding.QtCore import QLineF, QPointF, QRectF, Qt
from python_qt_binding.QtGui import QColor, QFontMetricsF, QPainter, QPalette, QPen
from python_qt_binding.QtWidgets import QGraphicsItem, QStyleOptionGraphicsItem, QWidget

from skiros2_gui.core.run_drawing import Column, Drawing
from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.run_node import short_duration
from skiros2_gui.core.states import RUNNING, look_of
from skiros2_gui.qt.theme import signal_colour

#: Below this scale names cannot be read and are not painted; below the second one, boxes are plain.
_READABLE, _PLAIN = 0.45, 0.25

#: So many changed nodes are painted one by one; of more, all that is in sight.
_MOST_SINGLE = 40

#: A column is as wide as the widest name in it, between these (letters).
NARROWEST, WIDEST = 6, 30

#: How much of the state's colour is in a box.
_TINT = 0.16


class TreeItem(QGraphicsItem):
    """Shows a drawing and the states of its nodes. Units are pixels at 100 %.

    :param widget: has the font and the colours.
    """

    def __init__(self, widget: QWidget) -> None:
        super().__init__()
        self.setFlag(QGraphicsItem.ItemUsesExtendedStyleOption)
        self._drawing: Drawing | None = None
        self._frame: Frame | None = None
        self._states = np.zeros(0, "i2")
        self._selected: int | None = None
        self._found: Collection[int] = ()
        self._marks: dict[int, str] = {}
        self._lefts: list[float] = []
        self._widths: list[float] = []
        self._names: dict[int, str] = {}
        self._bounds = QRectF()
        self.dress(widget)

    def dress(self, widget: QWidget) -> None:
        """Takes another font, or other colours."""
        self.prepareGeometryChange()
        self._widget, self._font, self._palette = widget, widget.font(), widget.palette()
        metrics = QFontMetricsF(self._font)
        self._letter = metrics.averageCharWidth()
        self._metrics = metrics
        self.box = metrics.height() + 10.0  # height of a node
        self.pitch = self.box + 7.0  # from a row to the next
        self._symbol = self.box  # room for the state's symbol
        self._tail = metrics.horizontalAdvance("99.99 s") + 10.0  # room for the fold mark, or the time
        self._gap = 30.0  # between columns
        text = self._palette.color(QPalette.Text)
        base = self._palette.color(QPalette.Base)
        self._line = QPen(_mixed(base, text, 0.35), 1.2)
        self._faint = _mixed(base, text, 0.6)
        self._tints: dict[int, tuple[QColor, QColor]] = {}
        if self._drawing is not None:
            self.draw(self._drawing)

    @property
    def drawing(self) -> Drawing | None:
        """What is shown."""
        return self._drawing

    def draw(self, drawing: Drawing) -> None:
        """Shows another drawing; `show_states` has to follow."""
        self.prepareGeometryChange()
        self._drawing = drawing
        self._names = {}
        self._lefts, self._widths = [], []
        left = 0.0
        for column in drawing.columns:
            width = self._widest(column) + self._symbol + self._tail
            self._lefts.append(left)
            self._widths.append(width)
            left += width + self._gap
        self._bounds = QRectF(-20.0, -20.0, left - self._gap + 40.0, drawing.height * self.pitch + self.box + 40.0)
        self._spines = [_spines(drawing, depth) for depth in range(len(drawing.columns))]
        self._frame = None
        self._states = np.full(len(drawing.shape), -1, "i2")
        self.update()

    def _widest(self, column: Column) -> float:
        """The room for the names of a column: that of the widest, if it is among the longest."""
        assert self._drawing is not None
        names = heapq.nlargest(12, (self._drawing.shape.name(place) for place in column.places), key=len)
        width = max(self._metrics.horizontalAdvance(name) for name in names) + 2.0
        return float(min(max(width, NARROWEST * self._letter), WIDEST * self._letter))

    def show_states(self, frame: Frame) -> None:
        """Takes the states of the tree that is drawn; paints anew what has changed."""
        if self._drawing is None or frame.shape is not self._drawing.shape:
            return
        states = frame.rows["state"]
        changed = np.flatnonzero(states != self._states)
        self._states, self._frame = states.copy(), frame
        runs = np.flatnonzero(states == RUNNING)  # their times go on
        touched = {*changed.tolist(), *(runs.tolist() if len(runs) <= _MOST_SINGLE else ())}
        self._repaint([place for place in touched if self._drawing.is_drawn(place)])

    def mark(self, selected: int | None, found: Collection[int], marks: dict[int, str]) -> None:
        """
        :param selected: the place of the selected node.
        :param found: the places of those that were searched for.
        :param marks: of those with breakpoints: `start`, `end`, or both.
        """
        found = frozenset(found)
        if (selected, found, marks) != (self._selected, self._found, self._marks):
            touched = {p for p in (selected, self._selected) if p is not None and selected != self._selected}
            touched |= set(found) ^ set(self._found)
            touched |= {p for p in {*marks, *self._marks} if marks.get(p) != self._marks.get(p)}
            self._selected, self._found, self._marks = selected, found, marks
            if self._drawing is not None:
                known = len(self._drawing.shape)
                self._repaint([p for p in touched if p < known and self._drawing.is_drawn(p)])

    def rect_of(self, place: int) -> QRectF:
        """The box of a node that is drawn."""
        assert self._drawing is not None
        depth = self._drawing.shape.depths[place]
        top = self._drawing.row[place] * self.pitch
        return QRectF(self._lefts[depth], top, self._widths[depth], self.box)

    def place_at(self, point: QPointF) -> int | None:
        """The node whose box a point is in."""
        if self._drawing is None or not self._lefts:
            return None
        depth = max(0, bisect.bisect_right(self._lefts, point.x()) - 1)
        row = point.y() / self.pitch
        column = self._drawing.columns[depth]
        for number in column.between(row - 1.0, row):
            if self.rect_of(column.places[number]).contains(point):
                return column.places[number]
        return None

    def is_fold_mark(self, place: int, point: QPointF) -> bool:
        """Whether a point is on what folds a node."""
        assert self._drawing is not None
        return bool(self._drawing.shape.children[place]) and point.x() > self.rect_of(place).right() - self._tail

    # -- painting ----------------------------------------------------------------------------------------------------

    def boundingRect(self) -> QRectF:
        return self._bounds

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        if self._drawing is None:
            return
        seen = option.exposedRect
        scale = option.levelOfDetailFromTransform(painter.worldTransform())
        painter.setRenderHint(QPainter.Antialiasing, scale >= _READABLE)
        self._paint_lines(painter, seen, scale)
        if scale < _PLAIN:
            self._paint_plain(painter, seen)
        else:
            self._paint_boxes(painter, seen, scale >= _READABLE)
        self._paint_selection(painter, seen, scale)

    def _seen(self, seen: QRectF) -> Iterator[tuple[int, int]]:
        """The depths and places of the nodes in sight."""
        assert self._drawing is not None
        top, bottom = seen.top() / self.pitch - 1.0, seen.bottom() / self.pitch
        for depth, column in enumerate(self._drawing.columns):
            if self._lefts[depth] <= seen.right() and self._lefts[depth] + self._widths[depth] >= seen.left():
                for number in column.between(top, bottom):
                    yield depth, column.places[number]

    def _paint_lines(self, painter: QPainter, seen: QRectF, scale: float) -> None:
        assert self._drawing is not None
        pen = QPen(self._line)
        pen.setWidthF(max(1.2, 1.0 / scale))
        painter.setPen(pen)
        row, half, lines = self._drawing.row, self.box / 2, []
        top, bottom = (seen.top() - half) / self.pitch, (seen.bottom() - half) / self.pitch
        for depth, (parents, firsts, lasts) in enumerate(self._spines):
            right = self._lefts[depth] + self._widths[depth]
            if not parents or right > seen.right() or right + self._gap < seen.left():
                continue
            middle, left = right + self._gap / 2, right + self._gap
            for number in range(bisect.bisect_left(lasts, top), bisect.bisect_right(firsts, bottom)):
                y = row[parents[number]] * self.pitch + half
                first, last = firsts[number] * self.pitch + half, lasts[number] * self.pitch + half
                lines.append(QLineF(right, y, middle, y))
                if last > first:
                    lines.append(QLineF(middle, first, middle, last))
            below = self._drawing.columns[depth + 1]
            for number in below.between(top, bottom):
                y = below.rows[number] * self.pitch + half
                lines.append(QLineF(middle, y, left, y))
        painter.drawLines(lines)

    def _paint_plain(self, painter: QPainter, seen: QRectF) -> None:
        """Boxes from afar: one call for all of a state."""
        by_state: dict[int, list[QRectF]] = {}
        for _, place in self._seen(seen):
            by_state.setdefault(int(self._states[place]), []).append(self.rect_of(place))
        painter.setPen(Qt.NoPen)
        for state, rects in by_state.items():
            painter.setBrush(self._colours(state)[0])
            painter.drawRects(rects)

    def _paint_boxes(self, painter: QPainter, seen: QRectF, is_readable: bool) -> None:
        painter.setFont(self._font)
        text = self._palette.color(QPalette.Text)
        row = self._drawing.row  # type: ignore[union-attr]
        for depth, place in self._seen(seen):
            state = int(self._states[place])
            strong, tint = self._colours(state)
            left, top, width = self._lefts[depth], row[place] * self.pitch, self._widths[depth]
            painter.setPen(QPen(strong, 2.4 if state == RUNNING else 1.1))
            painter.setBrush(tint)
            painter.drawRoundedRect(QRectF(left, top, width, self.box), 5.0, 5.0)
            if place in self._marks:
                self._paint_mark(painter, self._marks[place], left, top, width)
            if not is_readable:
                continue
            painter.setPen(strong)
            painter.drawText(QRectF(left, top, self._symbol, self.box), Qt.AlignCenter, look_of(state).symbol)
            painter.setPen(text)
            room = width - self._symbol - self._tail
            beside = QRectF(left + self._symbol, top, room, self.box)
            painter.drawText(beside, Qt.AlignVCenter | Qt.AlignLeft, self._name(place, room))
            self._paint_tail(painter, place, QRectF(left + width - self._tail, top, self._tail - 5.0, self.box))

    def _paint_tail(self, painter: QPainter, place: int, room: QRectF) -> None:
        """What folds a node, or for how long one that has nothing below ran."""
        drawing = self._drawing
        assert drawing is not None
        if drawing.shape.children[place]:
            hidden = drawing.hidden.get(place)
            text = f"+{hidden}" if hidden is not None else "−"
        else:
            duration = self._frame.duration(place) if self._frame is not None else None
            text = short_duration(duration) if duration is not None else ""
        painter.setPen(self._faint)
        painter.drawText(room, Qt.AlignVCenter | Qt.AlignRight, text)

    def _paint_mark(self, painter: QPainter, mark: str, left: float, top: float, width: float) -> None:
        """A breakpoint: a red dot where the node begins, or ends."""
        painter.setPen(QPen(self._palette.color(QPalette.Base), 1.0))
        painter.setBrush(signal_colour("failure", self._widget))
        for when, x in (("start", left), ("end", left + width)):
            if when in mark:
                painter.drawEllipse(QPointF(x, top + self.box / 2), 5.0, 5.0)

    def _paint_selection(self, painter: QPainter, seen: QRectF, scale: float) -> None:
        drawing = self._drawing
        assert drawing is not None
        thick = max(2.5, 2.0 / scale)
        painter.setBrush(Qt.NoBrush)
        if self._found:
            painter.setPen(QPen(signal_colour("changed", self._widget), thick, Qt.DashLine))
            for _, place in self._seen(seen):
                if place in self._found:
                    painter.drawRoundedRect(self.rect_of(place).adjusted(-3.0, -3.0, 3.0, 3.0), 6.0, 6.0)
        chosen = self._selected
        if chosen is not None and chosen < len(drawing.shape) and drawing.is_drawn(chosen):
            painter.setPen(QPen(self._palette.color(QPalette.Highlight), thick))
            painter.drawRoundedRect(self.rect_of(chosen).adjusted(-3.0, -3.0, 3.0, 3.0), 6.0, 6.0)

    def _repaint(self, places: list[int]) -> None:
        if len(places) > _MOST_SINGLE:
            self.update()
        else:
            for place in places:
                self.update(self.rect_of(place).adjusted(-7.0, -5.0, 7.0, 5.0))

    def _name(self, place: int, room: float) -> str:
        """The name as far as there is room for it; nodes that only group others are told by how they do."""
        name = self._names.get(place)
        if name is None:
            assert self._drawing is not None
            name = self._names[place] = self._metrics.elidedText(self._drawing.shape.name(place), Qt.ElideRight, room)
        return name

    def _colours(self, state: int) -> tuple[QColor, QColor]:
        """The colour of a state, and that of its boxes."""
        known = self._tints.get(state)
        if known is None:
            strong = signal_colour(look_of(state).signal, self._widget)
            known = self._tints[state] = (strong, _mixed(self._palette.color(QPalette.Base), strong, _TINT))
        return known


def _spines(drawing: Drawing, depth: int) -> tuple[list[int], list[float], list[float]]:
    """Of one column the nodes with children in sight, and the rows of their first and last child."""
    parents = [place for place in drawing.columns[depth].places if drawing.children[place]]
    firsts = [drawing.row[drawing.children[place][0]] for place in parents]
    lasts = [drawing.row[drawing.children[place][-1]] for place in parents]
    return parents, firsts, lasts


def _mixed(one: QColor, other: QColor, share: float) -> QColor:
    """So much of the other colour in one."""
    parts = zip(one.getRgb()[:3], other.getRgb()[:3], strict=True)
    return QColor(*(math.floor(a + (b - a) * share + 0.5) for a, b in parts))
