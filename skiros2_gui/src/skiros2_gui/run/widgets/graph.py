"""A drawn tree as one graphics item that paints visible nodes only."""

from __future__ import annotations

import bisect
import heapq
import math
from collections.abc import Collection, Iterator

import numpy as np
from python_qt_binding.QtCore import QLineF, QPointF, QRectF, Qt
from python_qt_binding.QtGui import QColor, QFontMetricsF, QPainter, QPalette, QPen
from python_qt_binding.QtWidgets import QGraphicsItem, QStyleOptionGraphicsItem, QWidget

from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.run.node import short_duration
from skiros2_gui.run.tree import Column, Drawing
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import RUNNING, style_of

#: Scales below which names, and the details of boxes, are not painted.
_READABLE, _PLAIN = 0.45, 0.25

#: If more nodes change, the whole view is repainted.
_MAX_SINGLE = 40

#: The minimum and maximum width of a column (letters).
NARROWEST, WIDEST = 6, 30

#: The share of the state's colour in a box.
_TINT = 0.16


class TreeItem(QGraphicsItem):
    """Shows a drawing and the states of its nodes. Units are pixels at 100 %.

    :param widget: provides font and palette.
    """

    def __init__(self, widget: QWidget) -> None:
        super().__init__()
        self.setFlag(QGraphicsItem.ItemUsesExtendedStyleOption)
        self._drawing: Drawing | None = None
        self._frame: Frame | None = None
        self._states = np.zeros(0, "i2")
        self._selected: int | None = None
        self._found: Collection[int] = ()
        self._breakpoints: dict[int, str] = {}
        self._lefts: list[float] = []
        self._widths: list[float] = []
        self._names: dict[int, str] = {}
        self._bounds = QRectF()
        self.set_style(widget)

    def set_style(self, widget: QWidget) -> None:
        """Takes font and colours of a widget."""
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
        """The shown drawing."""
        return self._drawing

    def draw(self, drawing: Drawing) -> None:
        """Shows a drawing; `show_states` has to follow."""
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
        """Returns the width of a column's names, estimated from the longest ones."""
        assert self._drawing is not None
        names = heapq.nlargest(12, (self._drawing.shape.name(index) for index in column.nodes), key=len)
        width = max(self._metrics.horizontalAdvance(name) for name in names) + 2.0
        return float(min(max(width, NARROWEST * self._letter), WIDEST * self._letter))

    def show_states(self, frame: Frame) -> None:
        """Shows the states of a frame; repaints the nodes that have changed."""
        if self._drawing is None or frame.shape is not self._drawing.shape:
            return
        states = frame.rows["state"]
        changed = np.flatnonzero(states != self._states)
        self._states, self._frame = states.copy(), frame
        runs = np.flatnonzero(states == RUNNING)  # their durations change
        changed_nodes = {*changed.tolist(), *(runs.tolist() if len(runs) <= _MAX_SINGLE else ())}
        self._repaint([index for index in changed_nodes if self._drawing.is_drawn(index)])

    def highlight(self, selected: int | None, found: Collection[int], breakpoints: dict[int, str]) -> None:
        """Highlights nodes.

        :param selected: the index of the selected node.
        :param found: the indices of the nodes that match the search.
        :param breakpoints: `start`, `end` or both, by node index.
        """
        found = frozenset(found)
        if (selected, found, breakpoints) != (self._selected, self._found, self._breakpoints):
            changed_nodes = {p for p in (selected, self._selected) if p is not None and selected != self._selected}
            changed_nodes |= set(found) ^ set(self._found)
            known = {*breakpoints, *self._breakpoints}
            changed_nodes |= {i for i in known if breakpoints.get(i) != self._breakpoints.get(i)}
            self._selected, self._found, self._breakpoints = selected, found, breakpoints
            if self._drawing is not None:
                count = len(self._drawing.shape)
                self._repaint([i for i in changed_nodes if i < count and self._drawing.is_drawn(i)])

    def rect_of(self, index: int) -> QRectF:
        """Returns the box of a drawn node."""
        assert self._drawing is not None
        depth = self._drawing.shape.depths[index]
        top = self._drawing.row[index] * self.pitch
        return QRectF(self._lefts[depth], top, self._widths[depth], self.box)

    def index_at(self, point: QPointF) -> int | None:
        """Returns the node at a point, or None."""
        if self._drawing is None or not self._lefts:
            return None
        depth = max(0, bisect.bisect_right(self._lefts, point.x()) - 1)
        row = point.y() / self.pitch
        column = self._drawing.columns[depth]
        for number in column.between(row - 1.0, row):
            if self.rect_of(column.nodes[number]).contains(point):
                return column.nodes[number]
        return None

    def is_fold_mark(self, index: int, point: QPointF) -> bool:
        """Returns whether a point is on the fold mark of a node."""
        assert self._drawing is not None
        return bool(self._drawing.shape.children[index]) and point.x() > self.rect_of(index).right() - self._tail

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
        """Yields depth and index of the visible nodes."""
        assert self._drawing is not None
        top, bottom = seen.top() / self.pitch - 1.0, seen.bottom() / self.pitch
        for depth, column in enumerate(self._drawing.columns):
            if self._lefts[depth] <= seen.right() and self._lefts[depth] + self._widths[depth] >= seen.left():
                for number in column.between(top, bottom):
                    yield depth, column.nodes[number]

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
        """Paints boxes without text, with one call per state."""
        by_state: dict[int, list[QRectF]] = {}
        for _, index in self._seen(seen):
            by_state.setdefault(int(self._states[index]), []).append(self.rect_of(index))
        painter.setPen(Qt.NoPen)
        for state, rects in by_state.items():
            painter.setBrush(self._colours(state)[0])
            painter.drawRects(rects)

    def _paint_boxes(self, painter: QPainter, seen: QRectF, is_readable: bool) -> None:
        painter.setFont(self._font)
        text = self._palette.color(QPalette.Text)
        assert self._drawing is not None
        row = self._drawing.row
        for depth, index in self._seen(seen):
            state = int(self._states[index])
            strong, tint = self._colours(state)
            left, top, width = self._lefts[depth], row[index] * self.pitch, self._widths[depth]
            painter.setPen(QPen(strong, 2.4 if state == RUNNING else 1.1))
            painter.setBrush(tint)
            painter.drawRoundedRect(QRectF(left, top, width, self.box), 5.0, 5.0)
            if index in self._breakpoints:
                self._paint_breakpoint(painter, self._breakpoints[index], left, top, width)
            if not is_readable:
                continue
            painter.setPen(strong)
            painter.drawText(QRectF(left, top, self._symbol, self.box), Qt.AlignCenter, style_of(state).symbol)
            painter.setPen(text)
            room = width - self._symbol - self._tail
            beside = QRectF(left + self._symbol, top, room, self.box)
            painter.drawText(beside, Qt.AlignVCenter | Qt.AlignLeft, self._name(index, room))
            self._paint_tail(painter, index, QRectF(left + width - self._tail, top, self._tail - 5.0, self.box))

    def _paint_tail(self, painter: QPainter, index: int, room: QRectF) -> None:
        """Paints the fold mark, or the duration of a leaf node."""
        drawing = self._drawing
        assert drawing is not None
        if drawing.shape.children[index]:
            hidden = drawing.hidden.get(index)
            text = f"+{hidden}" if hidden is not None else "−"
        else:
            duration = self._frame.duration(index) if self._frame is not None else None
            text = short_duration(duration) if duration is not None else ""
        painter.setPen(self._faint)
        painter.drawText(room, Qt.AlignVCenter | Qt.AlignRight, text)

    def _paint_breakpoint(self, painter: QPainter, moments: str, left: float, top: float, width: float) -> None:
        """Paints a red dot at the start or end of a node."""
        painter.setPen(QPen(self._palette.color(QPalette.Base), 1.0))
        painter.setBrush(role_colour("failure", self._widget))
        for when, x in (("start", left), ("end", left + width)):
            if when in moments:
                painter.drawEllipse(QPointF(x, top + self.box / 2), 5.0, 5.0)

    def _paint_selection(self, painter: QPainter, seen: QRectF, scale: float) -> None:
        drawing = self._drawing
        assert drawing is not None
        thick = max(2.5, 2.0 / scale)
        painter.setBrush(Qt.NoBrush)
        if self._found:
            painter.setPen(QPen(role_colour("changed", self._widget), thick, Qt.DashLine))
            for _, index in self._seen(seen):
                if index in self._found:
                    painter.drawRoundedRect(self.rect_of(index).adjusted(-3.0, -3.0, 3.0, 3.0), 6.0, 6.0)
        chosen = self._selected
        if chosen is not None and chosen < len(drawing.shape) and drawing.is_drawn(chosen):
            painter.setPen(QPen(self._palette.color(QPalette.Highlight), thick))
            painter.drawRoundedRect(self.rect_of(chosen).adjusted(-3.0, -3.0, 3.0, 3.0), 6.0, 6.0)

    def _repaint(self, indices: list[int]) -> None:
        if len(indices) > _MAX_SINGLE:
            self.update()
        else:
            for index in indices:
                self.update(self.rect_of(index).adjusted(-7.0, -5.0, 7.0, 5.0))

    def _name(self, index: int, room: float) -> str:
        """Returns the elided name."""
        name = self._names.get(index)
        if name is None:
            assert self._drawing is not None
            name = self._names[index] = self._metrics.elidedText(self._drawing.shape.name(index), Qt.ElideRight, room)
        return name

    def _colours(self, state: int) -> tuple[QColor, QColor]:
        """Returns the colours of a state's frame and box."""
        known = self._tints.get(state)
        if known is None:
            strong = role_colour(style_of(state).colour_role, self._widget)
            known = self._tints[state] = (strong, _mixed(self._palette.color(QPalette.Base), strong, _TINT))
        return known


def _spines(drawing: Drawing, depth: int) -> tuple[list[int], list[float], list[float]]:
    """Returns the nodes of a column with drawn children, and the rows of their first and last child."""
    parents = [index for index in drawing.columns[depth].nodes if drawing.children[index]]
    firsts = [drawing.row[drawing.children[index][0]] for index in parents]
    lasts = [drawing.row[drawing.children[index][-1]] for index in parents]
    return parents, firsts, lasts


def _mixed(one: QColor, other: QColor, share: float) -> QColor:
    """Blends a share of the other colour into one."""
    parts = zip(one.getRgb()[:3], other.getRgb()[:3], strict=True)
    return QColor(*(math.floor(a + (b - a) * share + 0.5) for a, b in parts))
