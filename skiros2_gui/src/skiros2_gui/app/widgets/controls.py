"""Buttons, labels and timers with their properties."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

from python_qt_binding.QtCore import QObject, Qt, QTimer
from python_qt_binding.QtWidgets import QLabel, QPushButton, QToolButton

#: The property of buttons on which the space bar toggles the tab's task.
SPACE_TOGGLES = "spaceToggles"


#: The most characters of a label: Qt crashes when it paints a line of some 100 000 letters.
_MAX_TEXT = 10_000


class PlainLabel(QLabel):
    """A label that shows its text as it is: names and messages come from anywhere, and could pose as something else."""

    def __init__(self, text: str = "") -> None:
        super().__init__()
        self.setTextFormat(Qt.PlainText)
        self.setText(text)

    def setText(self, text: str) -> None:
        super().setText(text if len(text) <= _MAX_TEXT else f"{text[:_MAX_TEXT]}...")


def plain_tip(text: str) -> str:
    """Returns a tool tip that is shown as it is: Qt takes texts with tags for HTML."""
    return f"<span>{escape(text).replace(chr(10), '<br>')}</span>" if Qt.mightBeRichText(text) else text


def push_button(text: str, name: str, clicked: Callable[[], Any], tip: str = "") -> QPushButton:
    """Returns a button.

    :param name: the object name, by which tests find it.
    """
    button = QPushButton(text)
    button.setObjectName(name)
    button.setToolTip(plain_tip(tip))
    button.clicked.connect(lambda: clicked())
    return button


def tool_button(text: str, name: str, clicked: Callable[[], Any] | None = None, tip: str = "") -> QToolButton:
    """Returns a small button; see `push_button`. Without `clicked` it opens its menu."""
    button = QToolButton()
    button.setText(text)
    button.setObjectName(name)
    button.setToolTip(plain_tip(tip))
    button.setAccessibleName(text or tip)
    if clicked is None:
        button.setPopupMode(QToolButton.InstantPopup)
    else:
        button.clicked.connect(lambda: clicked())
    return button


def text_label(name: str, is_selectable: bool = True) -> QLabel:
    """Returns a label of plain text with line breaks, which may come from anywhere."""
    label = PlainLabel()
    label.setObjectName(name)
    label.setWordWrap(True)
    if is_selectable:
        label.setTextInteractionFlags(Qt.TextSelectableByMouse)
    return label


def timer(parent: QObject, period: int, call: Callable[[], Any], repeats: bool = False) -> QTimer:
    """Returns a timer (ms), which is not started."""
    made = QTimer(parent)
    made.setSingleShot(not repeats)
    made.setInterval(period)
    made.timeout.connect(call)
    return made
