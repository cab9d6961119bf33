"""A pad that applies a force at the tool of a simulated arm while it is dragged."""

from __future__ import annotations

import math
from typing import Any

from python_qt_binding.QtCore import QPointF, QSize, Qt, Signal
from python_qt_binding.QtGui import QPainter, QPalette, QPen
from python_qt_binding.QtWidgets import QWidget

from skiros2_gui.app.widgets.controls import timer
from skiros2_gui.app.widgets.theme import role_colour

#: How often the force is emitted while the pad is dragged (ms).
PERIOD = 100

#: The share of the pad's radius without a force.
_DEAD = 0.08


class ForcePad(QWidget):
    """Seen from above: up is x of the map, left is y. With Shift, up and down are z."""

    #: A force (N) as x, y, z in the map; emitted periodically while the pad is dragged.
    pushed = Signal(float, float, float)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("forcePad")
        self.setAccessibleName("force at the tool")
        self.setFocusPolicy(Qt.NoFocus)
        self.maximum = 15.0
        self._at: QPointF | None = None  # share of the radius, right and up
        self._is_vertical = False
        self._timer = timer(self, PERIOD, self._emit, repeats=True)

    @property
    def force(self) -> tuple[float, float, float]:
        """The present force (N) in the map."""
        length = math.hypot(self._at.x(), self._at.y()) if self._at is not None else 0.0
        if self._at is None or length < _DEAD:
            return (0.0, 0.0, 0.0)
        scale = self.maximum * min(1.0, length) / length
        right, up = scale * self._at.x(), scale * self._at.y()
        return (0.0, 0.0, up) if self._is_vertical else (up, -right, 0.0)

    def sizeHint(self) -> QSize:
        size = 7 * self.fontMetrics().height()
        return QSize(size, size)

    def minimumSizeHint(self) -> QSize:
        return self.sizeHint()

    def stop(self) -> None:
        """Ends the force."""
        self._timer.stop()
        self._at = None
        self.update()

    def mousePressEvent(self, event: Any) -> None:
        if event.button() == Qt.LeftButton:
            self._follow(event)
            self._emit()
            self._timer.start()

    def mouseMoveEvent(self, event: Any) -> None:
        if self._at is not None:
            self._follow(event)

    def mouseReleaseEvent(self, event: Any) -> None:
        self.stop()

    def hideEvent(self, event: Any) -> None:
        super().hideEvent(event)
        self.stop()

    def changeEvent(self, event: Any) -> None:
        super().changeEvent(event)
        if not self.isEnabled():
            self.stop()

    def _follow(self, event: Any) -> None:
        centre, radius = QPointF(self.rect().center()), self._radius()
        off = QPointF(event.pos()) - centre
        self._at = QPointF(off.x() / radius, -off.y() / radius)
        self._is_vertical = bool(event.modifiers() & Qt.ShiftModifier)
        self.update()

    def _emit(self) -> None:
        force = self.force
        if any(force):
            self.pushed.emit(*force)

    def _radius(self) -> float:
        return max(1.0, min(self.width(), self.height()) / 2.0 - 3.0)

    def paintEvent(self, event: Any) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.Antialiasing)
        group = QPalette.Normal if self.isEnabled() else QPalette.Disabled
        text = self.palette().color(group, QPalette.Text)
        centre, radius = QPointF(self.rect().center()), self._radius()
        painter.setPen(QPen(text, 1))
        painter.setBrush(self.palette().color(group, QPalette.Base))
        painter.drawEllipse(centre, radius, radius)
        for x, y, name in ((0.0, -0.8, "x"), (-0.8, 0.0, "y")):
            at = centre + QPointF(x * radius, y * radius)
            painter.drawText(at + QPointF(-3.0, 4.0), name)
        if self._at is None:
            return
        painter.setPen(QPen(role_colour("running", self), 2))
        length = max(1.0, math.hypot(self._at.x(), self._at.y()))
        tip = centre + QPointF(self._at.x(), -self._at.y()) * radius / length
        painter.drawLine(centre, tip)
        painter.setBrush(role_colour("running", self))
        painter.drawEllipse(tip, 4.0, 4.0)
