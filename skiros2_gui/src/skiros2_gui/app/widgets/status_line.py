"""The status line: the system's parts and running jobs."""

from __future__ import annotations

from python_qt_binding.QtCore import Qt, QTimer
from python_qt_binding.QtWidgets import QHBoxLayout, QLabel, QProgressBar, QSizePolicy, QWidget

from skiros2_gui.app.events import ConnectionChanged, ManagersChanged
from skiros2_gui.app.health import sentence, short, sign
from skiros2_gui.app.widgets.theme import tint
from skiros2_gui.app.window import Window

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
        self.busy = QLabel()
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
        self._delay = QTimer(self)
        self._delay.setSingleShot(True)
        self._delay.setInterval(BUSY_AFTER)
        self._delay.timeout.connect(self._show_busy)
        window.jobs.on_busy(self._on_busy)
        window.subscribe(ConnectionChanged, lambda _: self.show_parts())
        window.subscribe(ManagersChanged, lambda _: self.show_parts())
        self.show_parts()

    def set_dark(self, dark: bool) -> None:
        """Switches between the dark and the light theme."""
        self._is_dark = dark
        self.show_parts()

    def show_parts(self) -> None:
        """Updates the labels of the parts."""
        parts = self._window.system.parts
        while len(self.parts) > len(parts):
            self.parts.pop().deleteLater()
        while len(self.parts) < len(parts):
            label = QLabel()
            label.setTextFormat(Qt.PlainText)
            self.parts.append(label)
            self._signs.addWidget(label)
        for label, part in zip(self.parts, parts, strict=True):
            symbol, colour = sign(part)
            label.setText(f"{symbol} {short(part)}")
            label.setToolTip(sentence(part))
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
