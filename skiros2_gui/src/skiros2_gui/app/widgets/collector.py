"""Garbage collection in the thread of the window."""

from __future__ import annotations

import gc

from python_qt_binding.QtCore import QObject, QTimer

#: Period of the checks (ms).
_PERIOD = 500


class Collector(QTimer):
    """Collects garbage in the thread of the window, by the thresholds of `gc`, as long as the window is open.

    Python collects in whichever thread creates the next object. A widget that another thread frees crashes Qt.

    Modules and what else exists at the start are not visited: a full collection held the window for 20 ms longer.
    """

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._was_enabled = gc.isenabled()
        gc.disable()
        gc.freeze()
        self.timeout.connect(self._check)
        self.start(_PERIOD)

    def close(self) -> None:
        """Returns the collection to Python."""
        self.stop()
        gc.unfreeze()
        if self._was_enabled:
            gc.enable()

    def _check(self) -> None:
        generations = enumerate(zip(gc.get_count(), gc.get_threshold(), strict=True))
        due = [generation for generation, (count, threshold) in generations if count > threshold]
        if due:
            gc.collect(due[-1])
