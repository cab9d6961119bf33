"""The button that stops everything, and the report of what it has stopped."""

from __future__ import annotations

import time

from python_qt_binding.QtCore import QSize, Qt
from python_qt_binding.QtWidgets import QHBoxLayout, QSizePolicy, QTabBar, QWidget

from skiros2_gui.app.events import StopRequested, StopTarget, TaskStarted
from skiros2_gui.app.system import clock
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, timer
from skiros2_gui.app.window import Window

#: The period at which the report is updated while something is ending (ms).
_PERIOD = 200

#: White on red has a contrast of 5.6 in both themes.
_STYLE = """
QPushButton { background: #c62828; color: white; font-weight: bold; border: 1px solid #8e1b1b; border-radius: 4px; }
QPushButton:hover { background: #d83a3a; }
QPushButton:pressed { background: #8e1b1b; }
QPushButton:focus { border: 2px solid palette(window-text); }
"""


class StopControl(QWidget):
    """The stop button with the report at its left. `stop` does what a click does."""

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._window = window
        self._targets: list[StopTarget] = []
        self._stamp = 0.0
        self.report = PlainLabel()
        self.report.setObjectName("stopReport")
        self.report.setTextFormat(Qt.PlainText)
        self.report.setAlignment(Qt.AlignRight | Qt.AlignVCenter)
        self.report.setSizePolicy(QSizePolicy.Preferred, QSizePolicy.Preferred)
        self.button = push_button(
            "■  STOP",
            "stopAllButton",
            self.stop,
            "Stops all tasks of all robots, and the goal  (Esc, Ctrl+.)\nNot a safety-rated emergency stop",
        )
        self.button.setStyleSheet(_STYLE)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 2, 4, 2)
        row.addWidget(self.report, 1)
        row.addWidget(self.button)
        self._timer = timer(self, _PERIOD, self._show, repeats=True)
        self._fit_text()
        window.subscribe(TaskStarted, lambda _: self._clear())

    def stop(self) -> None:
        """Stops everything, and reports what was running."""
        request = StopRequested()
        self._window.publish(request)
        self._targets, self._stamp = request.targets, time.time()
        self._show()
        self._timer.start()

    def close_timer(self) -> None:
        """Stops the timer."""
        self._timer.stop()

    def _clear(self) -> None:
        self._timer.stop()
        self.report.clear()
        self.report.setToolTip("")

    def _show(self) -> None:
        names = [target.name for target in self._targets]
        waiting = [target.name for target in self._targets if not target.has_ended()]
        if not waiting:
            self._timer.stop()
        if not names:
            text = "nothing was running; all robots were sent a stop"
        elif waiting:
            text = f"stopping {_listed(waiting)}"
        else:
            text = f"stopped {_listed(names)}"
        self.report.setText(f"{clock(self._stamp)}  {text}")
        self.report.setToolTip(plain_tip("\n".join(names)))

    def _fit_text(self) -> None:
        em = self.fontMetrics().height()
        self.button.setFixedSize(QSize(9 * em, tab_height(self) - 4))


def tab_height(widget: QWidget) -> int:
    """Returns the height of the row of tabs (pixels), which limits that of the button."""
    return round(2.4 * widget.fontMetrics().height())


class TallTabBar(QTabBar):
    """Tabs as high as the stop button beside them."""

    def tabSizeHint(self, index: int) -> QSize:
        size = super().tabSizeHint(index)
        return QSize(size.width(), max(size.height(), tab_height(self)))


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    return f"{', '.join(names[:2])}{more}"
