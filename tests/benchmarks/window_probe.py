"""The window in a process of its own that measures itself: when it is up, its CPU time, and holds of the Qt thread.

Prints a line of JSON when the window is up; then, for each line of standard input, the title of a tab and seconds,
shows that tab for so long and prints a line of what was measured. Ends at the end of the input.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from python_qt_binding.QtCore import QObject, Qt, QTimer, Signal
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui.app.events import WorldChanged
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_live.core.patch import TaskProgress

#: A hold shows as a tick of the probe that comes late (ms).
_TICK = 4
#: What is shown at first is not measured (s).
_SETTLE = 2.0


class Probe(QObject):
    """Measures while a tab is shown. `asked` may be emitted by any thread."""

    asked = Signal(str)
    ended = Signal()

    def __init__(self, window: MainWidget) -> None:
        super().__init__()
        self._window = window
        self._timer = QTimer(self)
        self._timer.setTimerType(Qt.PreciseTimer)
        self._timer.setInterval(_TICK)
        self._timer.timeout.connect(self._tick)
        self._last = self._last_cpu = 0.0
        self._holds: list[tuple[float, float]] = []
        self._counts = {"changes": 0, "progress": 0}
        window.shared.subscribe(WorldChanged, lambda event: self._count("changes", len(event.changes)))
        window.shared.subscribe(TaskProgress, lambda _: self._count("progress", 1))
        self.asked.connect(self._begin)

    def _count(self, what: str, more: int) -> None:
        self._counts[what] += more

    def _begin(self, line: str) -> None:
        title, _, seconds = line.strip().rpartition(" ")
        titles = [self._window.tabs.tabText(i) for i in range(self._window.tabs.count())]
        self._window.tabs.setCurrentIndex(titles.index(title))
        QTimer.singleShot(int(1000 * _SETTLE), lambda: self._measure(float(seconds)))

    def _measure(self, seconds: float) -> None:
        self._holds = []
        self._counts = dict.fromkeys(self._counts, 0)
        self._last, self._last_cpu = time.perf_counter(), time.thread_time()
        begin = (time.perf_counter(), time.process_time(), time.thread_time())
        self._timer.start()
        QTimer.singleShot(int(1000 * seconds), Qt.PreciseTimer, lambda: self._end(begin))

    def _tick(self) -> None:
        now, cpu = time.perf_counter(), time.thread_time()
        self._holds.append((now - self._last, cpu - self._last_cpu))
        self._last, self._last_cpu = now, cpu

    def _end(self, begin: tuple[float, float, float]) -> None:
        self._timer.stop()
        wall = time.perf_counter() - begin[0]
        tell(
            {
                # "part" of a core; "longest": ms between two ticks of the probe, and of that the Qt thread computing
                "part": (time.process_time() - begin[1]) / wall,
                "part_of_qt": (time.thread_time() - begin[2]) / wall,
                "longest": 1000.0 * max(held for held, _ in self._holds),
                "longest_computing": 1000.0 * max(computed for _, computed in self._holds),
                **{what: count / wall for what, count in self._counts.items()},
            }
        )


def tell(what: dict[str, Any]) -> None:
    print(json.dumps(what), flush=True)


def when(condition: Callable[[], Any], then: Callable[[], None]) -> None:
    """Calls `then` once the condition is true; looks every 5 ms."""
    if condition():
        then()
    else:
        QTimer.singleShot(5, lambda: when(condition, then))


def main() -> int:
    application = QApplication(["probe"])
    window = MainWidget(RosSystem)
    window.resize(1200, 800)
    window.show()
    probe = Probe(window)

    def read() -> None:
        for line in sys.stdin:
            probe.asked.emit(line)
        probe.ended.emit()

    def up() -> None:
        window.repaint()
        tell({"up": time.time()})
        threading.Thread(target=read, daemon=True).start()

    probe.ended.connect(application.quit)
    when(lambda: window.system.scene is not None and window.system.managers, up)
    status = int(application.exec_())
    window.shut_down()
    return status


if __name__ == "__main__":
    sys.exit(main())
