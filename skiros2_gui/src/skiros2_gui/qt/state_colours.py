"""The colours of the states of tasks and steps."""

from __future__ import annotations

from python_qt_binding.QtGui import QBrush
from python_qt_binding.QtWidgets import QTreeWidgetItem, QWidget

from skiros2_gui.qt.theme import signal_colour

_SIGNALS = {
    "running": "running",
    "paused": "paused",
    "stopped": "paused",
    "succeeded": "success",
    "failed": "failure",
    "lost": "failure",
}


def colour_state(item: QTreeWidgetItem, column: int, state: str, widget: QWidget) -> None:
    """Gives a cell the colour of a state, as the widget's theme has it."""
    colour = signal_colour(_SIGNALS.get(state, "idle"), widget)
    if item.foreground(column).color() != colour:
        item.setForeground(column, QBrush(colour))


def colour_words(label: QWidget, signal: str) -> None:
    """Gives a label the colour of a signal; "" the usual one."""
    palette = QWidget.palette(label.parentWidget() or label)
    if signal:
        palette.setColor(label.foregroundRole(), signal_colour(signal, label))
    if label.palette() != palette:
        label.setPalette(palette)
