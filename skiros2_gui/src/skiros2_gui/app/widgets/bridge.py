"""Delivers events and results of other threads in the Qt thread, at a limited rate."""

from __future__ import annotations

import time

from python_qt_binding.QtCore import QObject, Qt, QTimer, Signal

from skiros2_gui.app.events import EventQueue
from skiros2_gui.app.jobs import Jobs
from skiros2_gui.app.problems import Problems
from skiros2_gui.app.window import Window

#: The least time between two batches of events (ms): 25 Hz.
EVENT_PERIOD = 40

#: The time after which a batch yields to user input (s); the rest follows in the next iteration.
EVENT_BUDGET = 0.02


class Bridge(QObject):
    """The event queue and the jobs of one window. Idle while there are no events.

    It has no parent and is referenced by the queue and the jobs: other threads may use them after the window was
    closed.
    """

    _ended = Signal()
    _event_posted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.problems = Problems()
        self.jobs = Jobs(self.problems, lambda: self._ended.emit())
        self.event_queue = EventQueue(lambda: self._event_posted.emit())
        self._window: Window | None = None
        self._last = 0.0
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setTimerType(Qt.PreciseTimer)
        self._timer.timeout.connect(self._take)
        self._ended.connect(self.jobs.deliver, Qt.QueuedConnection)
        self._event_posted.connect(self._soon, Qt.QueuedConnection)

    def attach(self, window: Window) -> None:
        """Delivers events to `window`, including those queued so far."""
        self._window = window
        self._soon()

    def close(self) -> None:
        """Stops the delivery. Other threads may still post events."""
        self._timer.stop()
        self._window = None
        self.jobs.close()

    def _soon(self) -> None:
        if self._window is not None and not self._timer.isActive():
            passed = (time.monotonic() - self._last) * 1000.0
            self._timer.start(max(0, int(EVENT_PERIOD - passed)))

    def _take(self) -> None:
        self._last = time.monotonic()
        if self._window is not None and self._window.process_events(EVENT_BUDGET):
            self._timer.start(0)
