"""Media icons in the text colour, visible in light and dark themes."""

from __future__ import annotations

from collections.abc import Sequence

from python_qt_binding.QtCore import QPointF, QRectF, Qt
from python_qt_binding.QtGui import QIcon, QPainter, QPalette, QPixmap, QPolygonF
from python_qt_binding.QtWidgets import QWidget

PLAY, PAUSE, STOP, STEP, BACK = "play", "pause", "stop", "step", "back"

Corners = Sequence[tuple[float, float]]

_RIGHT: Corners = ((0.0, 0.0), (1.0, 0.5), (0.0, 1.0))


def _bar(left: float, width: float) -> Corners:
    return ((left, 0.0), (left + width, 0.0), (left + width, 1.0), (left, 1.0))


#: Polygons in a square of side 1.
_SHAPES: dict[str, Sequence[Corners]] = {
    PLAY: (_RIGHT,),
    PAUSE: (_bar(0.08, 0.3), _bar(0.62, 0.3)),
    STOP: (_bar(0.0, 1.0),),
    STEP: (((0.0, 0.0), (0.7, 0.5), (0.0, 1.0)), _bar(0.76, 0.2)),
    BACK: (((1.0, 0.0), (0.3, 0.5), (1.0, 1.0)), _bar(0.04, 0.2)),
}

#: Side and margin (pixels); Qt scales the icon down.
_SIDE, _INSIDE = 64.0, 8.0


def media_icon(kind: str, widget: QWidget) -> QIcon:
    """Returns an icon for a button; to be made again when the palette changes.

    :param kind: `PLAY`, `PAUSE`, `STOP`, `STEP` or `BACK`.
    """
    icon = QIcon()
    for mode, group in ((QIcon.Normal, QPalette.Active), (QIcon.Disabled, QPalette.Disabled)):
        pixmap = QPixmap(int(_SIDE), int(_SIDE))
        pixmap.fill(Qt.transparent)
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.Antialiasing)
        painter.setPen(Qt.NoPen)
        painter.setBrush(widget.palette().color(group, QPalette.ButtonText))
        room = QRectF(0.0, 0.0, _SIDE, _SIDE).adjusted(_INSIDE, _INSIDE, -_INSIDE, -_INSIDE)
        for corners in _SHAPES[kind]:
            points = [QPointF(room.left() + x * room.width(), room.top() + y * room.height()) for x, y in corners]
            painter.drawPolygon(QPolygonF(points))
        painter.end()
        icon.addPixmap(pixmap, mode)
    return icon
