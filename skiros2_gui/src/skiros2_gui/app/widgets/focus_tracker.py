"""Tracks whether the user moved the keyboard focus to its widget, or Qt did."""

from __future__ import annotations

from python_qt_binding.QtCore import QEvent, QObject, Qt
from python_qt_binding.QtWidgets import QAbstractItemView, QApplication, QWidget

#: The property of buttons on which the space bar toggles the tab's task.
SPACE_TOGGLES = "spaceToggles"

#: The user moved the focus.
_CHOSEN = (Qt.MouseFocusReason, Qt.ShortcutFocusReason)

#: The focus returns to the widget that had it.
_RETURNED = (Qt.ActiveWindowFocusReason, Qt.PopupFocusReason, Qt.MenuBarFocusReason)

_TAB_KEYS = (Qt.Key_Tab, Qt.Key_Backtab)


class FocusTracker:
    """Follows the events of the application.

    When the focus widget is disabled or hidden, Qt moves the focus to the next widget, where the user does not expect
    to write. A widget counts as entered after a click into it, after the Tab key or a shortcut that led to it, when it
    edits a cell of a list, and as soon as a key other than the space bar is pressed in it.

    :ivar is_entered: whether the user entered the focus widget.
    """

    def __init__(self) -> None:
        self.is_entered = False
        self._is_tab_down = False

    def track(self, watched: QObject, event: QEvent) -> None:
        """Processes an event before `watched` gets it."""
        kind = event.type()
        if kind == QEvent.KeyPress:
            self._is_tab_down = event.key() in _TAB_KEYS
            if event.key() != Qt.Key_Space and watched is QApplication.focusWidget():
                self.is_entered = True
        elif kind == QEvent.KeyRelease:
            self._is_tab_down = False
        elif kind == QEvent.FocusIn and isinstance(watched, QWidget):
            if event.reason() not in _RETURNED:
                self.is_entered = event.reason() in _CHOSEN or self._is_tab_down or _edits_cell(watched)
        elif kind == QEvent.MouseButtonPress and isinstance(watched, QWidget):
            focus = QApplication.focusWidget()
            if focus is not None and (focus is watched or focus.isAncestorOf(watched)):
                self.is_entered = True


def _edits_cell(widget: QWidget) -> bool:
    viewport = widget.parentWidget()
    return viewport is not None and isinstance(viewport.parentWidget(), QAbstractItemView)
