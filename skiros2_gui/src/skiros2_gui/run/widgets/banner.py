"""The banner with the message of the task's root: why it is paused, or why it failed."""

from __future__ import annotations

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtWidgets import QLabel, QWidget

from skiros2_gui.app.widgets.theme import is_dark, tint
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import FAILURE
from skiros2_skill.core.runtime.history import one_line

#: The most characters shown (of the first line), and in the tooltip.
_LONGEST, _LONGEST_TIP = 240, 2000


class TaskBanner(QLabel):
    """A line above the tree, hidden without a message."""

    def __init__(self, parent: QWidget | None = None) -> None:
        self._has_failed = False
        self._colours: tuple[bool, bool] | None = None
        super().__init__(parent)
        self.setObjectName("taskNote")
        self.setTextFormat(Qt.PlainText)
        self.setTextInteractionFlags(Qt.TextSelectableByMouse)
        self.setWordWrap(True)
        self.setMargin(6)
        self.hide()

    def show_task(self, frame: Frame | None) -> None:
        """Shows the message of the root while the task is paused or after it has failed."""
        whole = frame.message(0).strip() if frame is not None and len(frame.shape) else ""
        line = one_line(whole)
        self._has_failed = bool(line) and frame is not None and frame.state(0) == FAILURE
        if frame is not None and frame.has_ended and not self._has_failed:
            line = ""
        text = line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
        if text != self.text():
            self.setText(text)
            self.setToolTip(whole[:_LONGEST_TIP] if text != whole else "")
        self._set_colours()
        self.setVisible(bool(text))

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() in (QEvent.ParentChange, QEvent.PaletteChange):
            self._set_colours()

    def _set_colours(self) -> None:
        """Follows the theme; the colours change the palette themselves."""
        colours = (self._has_failed, is_dark(self.parentWidget()))
        if colours != self._colours:
            self._colours = colours
            tint(self, background="error" if colours[0] else "notice", dark=colours[1])
