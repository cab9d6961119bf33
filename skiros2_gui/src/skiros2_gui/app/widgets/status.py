"""The status line and the error bar."""

from __future__ import annotations

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QGuiApplication
from python_qt_binding.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QProgressBar,
    QSizePolicy,
    QWidget,
)

from skiros2_gui.app.events import ConnectionChanged, ManagersChanged
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.system import clock, parts_of, sentence, short, sign
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label, timer, tool_button
from skiros2_gui.app.widgets.theme import tint
from skiros2_gui.app.window import Window
from skiros2_skill.core.runtime.history import one_line

#: The delay of the busy sign (ms).
BUSY_AFTER = 200


class StatusLine(QWidget):
    """A label for each part of the system, and the busy sign."""

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("status_line")
        self._window = window
        self._is_dark = False
        self.parts: list[QLabel] = []
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(9, 2, 9, 2)
        self._row.setSpacing(self.fontMetrics().height())
        self._signs = QHBoxLayout()
        self._signs.setSpacing(self.fontMetrics().height())
        self._row.addLayout(self._signs)
        self.busy = PlainLabel()
        self.busy.setTextFormat(Qt.PlainText)
        self.busy.setAlignment(Qt.AlignRight | Qt.AlignVCenter)
        self.busy.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self._row.addWidget(self.busy, 1)
        self.bar = QProgressBar()
        self.bar.setRange(0, 0)
        self.bar.setTextVisible(False)
        self.bar.setFixedSize(5 * self.fontMetrics().height(), self.fontMetrics().height() // 2)
        self.bar.hide()
        self._row.addWidget(self.bar)
        self._delay = timer(self, BUSY_AFTER, self._show_busy)
        window.jobs.on_busy(self._on_busy)
        window.subscribe(ConnectionChanged, lambda _: self.show_parts())
        window.subscribe(ManagersChanged, lambda _: self.show_parts())
        self.show_parts()

    def add(self, widget: QWidget) -> None:
        """Adds a widget at the end of the line."""
        self._row.addWidget(widget)

    def set_dark(self, dark: bool) -> None:
        """Switches between the dark and the light theme."""
        self._is_dark = dark
        self.show_parts()

    def show_parts(self) -> None:
        """Updates the labels of the parts."""
        parts = parts_of(self._window.tasks.cell)
        while len(self.parts) > len(parts):
            self.parts.pop().deleteLater()
        while len(self.parts) < len(parts):
            label = PlainLabel()
            label.setTextFormat(Qt.PlainText)
            self.parts.append(label)
            self._signs.addWidget(label)
        for label, part in zip(self.parts, parts, strict=True):
            symbol, colour = sign(part)
            label.setText(f"{symbol} {short(part)}")
            label.setToolTip(plain_tip(sentence(part)))
            font = label.font()
            font.setBold(colour == "failure")
            label.setFont(font)
            tint(label, text=colour, dark=self._is_dark)

    def _on_busy(self) -> None:
        if not self._window.jobs.activities:
            self._delay.stop()
            self.bar.hide()
            self.busy.clear()
        elif self.bar.isVisible():
            self._show_busy()
        elif not self._delay.isActive():
            self._delay.start()

    def _show_busy(self) -> None:
        doing = self._window.jobs.activities
        if doing:
            more = f" and {len(doing) - 1} more" if len(doing) > 1 else ""
            self.busy.setText(f"{doing[0]}{more}…")
            self.bar.show()


#: The most characters in the bar (of the first line), and in its tooltip (of the whole text).
MAX_SHOWN, MAX_IN_TIP = 400, 4000


class ErrorBar(QFrame):
    """Shows the newest problem until it is dismissed."""

    def __init__(self, problems: Problems, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._problems = problems
        self.setObjectName("error_bar")
        self.setFrameShape(QFrame.StyledPanel)
        self.text = text_label("")
        self.text.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.copy_button = push_button("Copy", "copyErrors", self.copy, "Copies the whole text")
        self.history_button = push_button("Earlier…", "earlierErrors", self.show_history, "Shows earlier errors")
        self.close_button = tool_button(
            "✕", "dismissError", problems.dismiss, "Dismisses this error; the history keeps it"
        )
        self.close_button.setAutoRaise(True)
        self.close_button.setAccessibleName("Dismiss the error")
        row = QHBoxLayout(self)
        row.setContentsMargins(9, 5, 5, 5)
        self._sign = PlainLabel("⚠")
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
            self.text.setToolTip(plain_tip(f"At {clock(newest.stamp)}{more}"))
