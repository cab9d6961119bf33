"""The line that says what went wrong, and the list of what went wrong before."""

from __future__ import annotations

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QGuiApplication, QKeySequence
from python_qt_binding.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QPushButton,
    QShortcut,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.core.health import clock
from skiros2_gui.core.problems import Problems
from skiros2_gui.qt.theme import tint
from skiros2_skill.core.runtime.history import one_line

#: So many characters of the first line of a text are shown, and of the whole text in the tooltip; the list has all.
MOST_SHOWN, MOST_IN_TIP = 400, 4000


class ErrorBar(QFrame):
    """Shows the newest problem until it is put away."""

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
        self.copy_button = _button("Copy", "Copies the whole text, to be sent to somebody", self.copy)
        self.history_button = _button("Earlier…", "Shows what went wrong before", self.show_history)
        self.close_button = QToolButton()
        self.close_button.setText("✕")
        self.close_button.setAutoRaise(True)
        self.close_button.setToolTip("Puts this line away; it stays in the list of earlier ones")
        self.close_button.setAccessibleName("Put the error away")
        self.close_button.clicked.connect(problems.put_away)
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
        """Takes the colours of the dark theme, or of the light one."""
        tint(self, background="error", dark=dark)
        tint(self._sign, text="failure", dark=dark)

    def copy(self) -> None:
        """Puts the whole text on the clipboard."""
        if self._problems.newest is not None:
            QGuiApplication.clipboard().setText(self._problems.newest.line)

    def show_history(self) -> None:
        """Opens the list of what went wrong."""
        dialog = ErrorHistory(self._problems, self.window())
        dialog.setAttribute(Qt.WA_DeleteOnClose)
        dialog.open()

    def _show(self) -> None:
        newest = self._problems.newest
        self.setVisible(newest is not None)
        if newest is not None:
            whole = newest.line.strip()
            line = one_line(whole)
            shown = line if len(line) <= MOST_SHOWN else f"{line[:MOST_SHOWN]}…"
            self.text.setText(shown)
            more = f"\n{whole[:MOST_IN_TIP]}" if shown != whole else ""
            self.text.setToolTip(f"At {clock(newest.stamp)}{more}")


class ErrorHistory(QDialog):
    """What went wrong, the newest first; copied by Ctrl+C."""

    def __init__(self, problems: Problems, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("What went wrong")
        self._problems = problems
        self.list = QListWidget()
        self.list.setWordWrap(True)
        self.list.setResizeMode(QListWidget.Adjust)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        self.list.setSpacing(2)
        self.list.setAlternatingRowColors(True)
        self.list.setSelectionMode(QListWidget.ExtendedSelection)
        for problem in problems.history:
            self.list.addItem(f"{clock(problem.stamp)}  {problem.line}")
        buttons = QDialogButtonBox(QDialogButtonBox.Close)
        copy = buttons.addButton("Copy", QDialogButtonBox.ActionRole)
        copy.setToolTip("Copies the selected lines, or all (Ctrl+C)")
        clear = buttons.addButton("Clear", QDialogButtonBox.ResetRole)
        copy.clicked.connect(self.copy)
        clear.clicked.connect(self._clear)
        buttons.rejected.connect(self.reject)
        QShortcut(QKeySequence(QKeySequence.Copy), self.list, self.copy)
        column = QVBoxLayout(self)
        column.addWidget(self.list)
        column.addWidget(buttons)
        em = self.fontMetrics().height()
        self.resize(45 * em, 25 * em)

    def copy(self) -> None:
        """Puts the selected lines, or all, on the clipboard."""
        rows = [self.list.item(row) for row in range(self.list.count())]
        chosen = [row for row in rows if row.isSelected()] or rows
        QGuiApplication.clipboard().setText("\n".join(row.text() for row in chosen))

    def _clear(self) -> None:
        self._problems.clear()
        self.list.clear()


def _button(text: str, tip: str, clicked: object) -> QPushButton:
    button = QPushButton(text)
    button.setToolTip(tip)
    button.clicked.connect(clicked)
    return button
