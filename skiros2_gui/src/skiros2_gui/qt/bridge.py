"""Brings what other threads have for the window into the window's thread, at a rate that it can follow."""

from __future__ import annotations

import time

from python_qt_binding.QtCore import QObject, Qt, QTimer, Signal

from skiros2_gui.core.inbox import Inbox
from skiros2_gui.core.jobs import Jobs
from skiros2_gui.core.problems import Problems
from skiros2_gui.core.window import Window

#: The least time between two batches of news (ms): 25 a second.
NEWS_PERIOD = 40

#: So long one batch may keep the window from answering to the user (s); what is left is told soon after.
NEWS_BUDGET = 0.02


class Bridge(QObject):
    """The inbox and the jobs of one window. Nothing runs while nothing comes in.

    It has no parent, and the inbox and the jobs hold it: other threads may bring things when the window has gone.
    """

    _ended = Signal()
    _came = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.problems = Problems()
        self.jobs = Jobs(self.problems, lambda: self._ended.emit())
        self.inbox = Inbox(lambda: self._came.emit())
        self._window: Window | None = None
        self._last = 0.0
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setTimerType(Qt.PreciseTimer)
        self._timer.timeout.connect(self._take)
        self._ended.connect(self.jobs.deliver, Qt.QueuedConnection)
        self._came.connect(self._soon, Qt.QueuedConnection)

    def attach(self, window: Window) -> None:
        """From now on `window` is told what comes in; also what has come in already."""
        self._window = window
        self._soon()

    def close(self) -> None:
        """Nothing is told any more. Other threads may go on bringing things."""
        self._timer.stop()
        self._window = None
        self.jobs.close()

    def _soon(self) -> None:
        if self._window is not None and not self._timer.isActive():
            passed = (time.monotonic() - self._last) * 1000.0
            self._timer.start(max(0, int(NEWS_PERIOD - passed)))

    def _take(self) -> None:
        self._last = time.monotonic()
        if self._window is not None and self._window.take_news(NEWS_BUDGET):
            self._timer.start(0)
