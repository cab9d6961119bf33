"""The error bar."""

from __future__ import annotations

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QGuiApplication
from python_qt_binding.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QPushButton,
    QSizePolicy,
    QToolButton,
    QWidget,
)

from skiros2_gui.app.health import clock
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.widgets.theme import tint
from skiros2_skill.core.runtime.history import one_line

#: The most characters in the bar (of the first line), and in its tooltip (of the whole text).
MAX_SHOWN, MAX_IN_TIP = 400, 4000


class ErrorBar(QFrame):
    """Shows the newest problem until it is dismissed."""

    def __init__(self, problems: Problems, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._problems = problems
        self.setObjectName("error_bar")
        self.setFrameShape(QFrame.StyledPanel)
        self.text = QLabel()
        self.text.setTextFormat(Qt.PlainText)
        self.text.setWordWrap(True)
        self.text.setTextInteractionFlags(Qt.TextSelectableByMouse)
        self.text.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.copy_button = _button("Copy", "Copies the whole text", self.copy)
        self.history_button = _button("Earlier…", "Shows earlier errors", self.show_history)
        self.close_button = QToolButton()
        self.close_button.setText("✕")
        self.close_button.setAutoRaise(True)
        self.close_button.setToolTip("Dismisses this error; the history keeps it")
        self.close_button.setAccessibleName("Dismiss the error")
        self.close_button.clicked.connect(problems.dismiss)
        row = QHBoxLayout(self)
        row.setContentsMargins(9, 5, 5, 5)
        self._sign = QLabel("⚠")
        row.addWidget(self._sign)
        row.addWidget(self.text, 1)
        for button in (self.copy_button, self.history_button, self.close_button):
            row.addWidget(button)
        problems.on_change(self._show)
        self._show()

    def set_dark(self, dark: bool) -> None:
        """Switches between the dark and the light theme."""
        tint(self, background="error", dark=dark)
        tint(self._sign, text="failure", dark=dark)

    def copy(self) -> None:
        """Copies the whole text to the clipboard."""
        if self._problems.newest is not None:
            QGuiApplication.clipboard().setText(self._problems.newest.line)

    def show_history(self) -> None:
        """Opens the list of errors, the newest first; its text can be selected and copied."""
        self.history = QPlainTextEdit("\n".join(f"{clock(p.stamp)}  {p.line}" for p in self._problems.history))
        self.history.setReadOnly(True)
        self.history.setParent(self.window(), Qt.Dialog)
        self.history.setAttribute(Qt.WA_DeleteOnClose)
        self.history.setWindowTitle("Errors")
        em = self.fontMetrics().height()
        self.history.resize(45 * em, 25 * em)
        self.history.show()

    def _show(self) -> None:
        newest = self._problems.newest
        self.setVisible(newest is not None)
        if newest is not None:
            whole = newest.line.strip()
            line = one_line(whole)
            shown = line if len(line) <= MAX_SHOWN else f"{line[:MAX_SHOWN]}…"
            self.text.setText(shown)
            more = f"\n{whole[:MAX_IN_TIP]}" if shown != whole else ""
            self.text.setToolTip(f"At {clock(newest.stamp)}{more}")


def _button(text: str, tip: str, clicked: object) -> QPushButton:
    button = QPushButton(text)
    button.setToolTip(tip)
    button.clicked.connect(clicked)
    return button
