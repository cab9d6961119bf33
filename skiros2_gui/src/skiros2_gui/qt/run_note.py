"""What a task says of itself as a whole: why it waits, or why it failed."""

from __future__ import annotations

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtWidgets import QLabel, QWidget

from skiros2_gui.core.run_frame import Frame
from skiros2_gui.core.states import FAILURE
from skiros2_gui.qt.theme import is_dark, tint
from skiros2_skill.core.runtime.history import one_line

#: So many characters of the first line are shown; the tooltip has more.
_LONGEST, _LONGEST_TIP = 240, 2000


class TaskNote(QLabel):
    """A line above the tree, which is there only when there is something to say."""

    def __init__(self, parent: QWidget | None = None) -> None:
        self._has_failed = False
        self._dressed: tuple[bool, bool] | None = None
        super().__init__(parent)
        self.setObjectName("taskNote")
        self.setTextFormat(Qt.PlainText)
        self.setTextInteractionFlags(Qt.TextSelectableByMouse)
        self.setWordWrap(True)
        self.setMargin(6)
        self.hide()

    def show_task(self, frame: Frame | None) -> None:
        """Shows what the root of a tree says while it is held back, or after it has failed."""
        whole = frame.message(0).strip() if frame is not None and len(frame.shape) else ""
        said = one_line(whole)
        self._has_failed = bool(said) and frame is not None and frame.state(0) == FAILURE
        if frame is not None and frame.has_ended and not self._has_failed:
            said = ""
        text = said if len(said) <= _LONGEST else f"{said[: _LONGEST - 1]}…"
        if text != self.text():
            self.setText(text)
            self.setToolTip(whole[:_LONGEST_TIP] if text != whole else "")
        self._dress()
        self.setVisible(bool(text))

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() in (QEvent.ParentChange, QEvent.PaletteChange):
            self._dress()

    def _dress(self) -> None:
        """Takes the colours of the theme; they are a change of the palette themselves."""
        wanted = (self._has_failed, is_dark(self.parentWidget()))
        if wanted != self._dressed:
            self._dressed = wanted
            tint(self, background="error" if wanted[0] else "notice", dark=wanted[1])
