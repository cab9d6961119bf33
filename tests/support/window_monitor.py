"""A window in a separate process, offscreen, that prints changes of its status line and its banners.

For tests of what a test's own process cannot be in: a window on another master, or without one.
"""

from __future__ import annotations

import signal
import sys

from python_qt_binding.QtCore import QTimer
from python_qt_binding.QtWidgets import QApplication

from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget

_PERIOD = 20  # ms


def main() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Python itself would look only when Qt calls it
    application = QApplication([*sys.argv[:1], "-platform", "offscreen"])
    content = MainWidget(RosSystem)
    content.show()
    said = ""

    def look() -> None:
        nonlocal said
        signs = [label.text() for label in content.status.parts]
        banners = [page.banner.text() for page in content.pages]
        line = " | ".join([*signs, *filter(None, banners)])
        if line != said:
            said = line
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()

    timer = QTimer()
    timer.timeout.connect(look)
    timer.start(_PERIOD)
    application.exec_()


if __name__ == "__main__":
    main()
