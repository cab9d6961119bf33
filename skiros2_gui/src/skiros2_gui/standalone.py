"""The standalone window, for machines without rqt."""

from __future__ import annotations

import json
import logging
import math
import signal
import sys
import threading
from collections.abc import Sequence
from typing import Any

from python_qt_binding.QtCore import QByteArray, QSettings, Qt, QTimer
from python_qt_binding.QtGui import QCloseEvent, QKeySequence
from python_qt_binding.QtWidgets import QAction, QActionGroup, QApplication, QMainWindow, QMessageBox

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.ros.plugins import load_plugins
from skiros2_gui.app.events import NodeShutdown
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.app.widgets.theme import CHOICES, SYSTEM, apply_theme
from skiros2_gui.launcher import display_problem

log = logging.getLogger(__name__)

#: The exit status without a display.
NO_DISPLAY = 2

#: The time to unregister from the master (s).
_SHUTDOWN_TIMEOUT = 2.0

#: The longest delay of a signal (ms).
_SIGNAL_PERIOD = 200

_THEMES = {"system": "As the desktop", "light": "Light", "dark": "Dark"}

_KEYS = """\
Space\tstart or stop what is selected
Arrows\tmove in lists and trees
Esc, Ctrl+.\tstop all tasks of all robots, and the goal
Ctrl+F\tfind
Alt+1, 2, 3, 4\tSkills, Running, World model, 3D (where rviz is installed)
Ctrl++, Ctrl+-, Ctrl+0\tlarger, smaller, usual text
Ctrl+Q\tclose the window"""


class StandaloneWindow(QMainWindow):
    """The main widget with a menu. Stores the user's settings.

    :param settings: the settings store.
    """

    def __init__(self, content: MainWidget, settings: QSettings) -> None:
        super().__init__()
        self.setObjectName("standalone")
        self.setWindowTitle("SkiROS")
        self.content = content
        self._settings = settings
        self._usual_size = QApplication.font().pointSizeF()
        self.setCentralWidget(content)
        for shortcut in content.stop_keys:
            shortcut.setContext(Qt.WindowShortcut)  # also with the focus in the menu, or nowhere
        self._fill_menu()
        self._restore()
        content.shared.subscribe(NodeShutdown, self._on_node_end)

    def closeEvent(self, event: QCloseEvent) -> None:
        """Stores the settings and shuts down the content."""
        try:
            self._settings.setValue("geometry", self.saveGeometry())
            self._settings.setValue("content", json.dumps(self.content.settings()))
            self._settings.sync()
        except FOREIGN_ERRORS:  # the window closes nevertheless
            log.exception("storing the settings of the window failed")
        self.content.shut_down()
        super().closeEvent(event)

    def _on_node_end(self, event: NodeShutdown) -> None:
        """Closes the window when ROS shuts down its node, as for any node."""
        log.warning("closing the window: ROS has shut down its node: %s", event.reason)
        self.close()

    def set_theme(self, choice: str) -> None:
        """Applies a theme and stores it.

        :param choice: one of `theme.CHOICES`.
        """
        apply_theme(QApplication.instance(), choice)
        self._settings.setValue("theme", choice)

    def zoom(self, steps: int) -> None:
        """Enlarges the text by some points; 0 restores the default size."""
        font = QApplication.font()
        size = font.pointSizeF() + steps if steps else self._usual_size
        font.setPointSizeF(min(max(size, 6.0), 32.0))
        QApplication.setFont(font)
        self._settings.setValue("text_size", font.pointSizeF())

    def _fill_menu(self) -> None:
        menu = self.menuBar().addMenu("&Window")
        themes = menu.addMenu("&Colours")
        group = QActionGroup(self)
        self.themes: dict[str, QAction] = {}
        for choice in CHOICES:
            action = themes.addAction(_THEMES[choice])
            action.setObjectName(f"theme_{choice}")
            action.setCheckable(True)
            action.triggered.connect(lambda _, chosen=choice: self.set_theme(chosen))
            group.addAction(action)
            self.themes[choice] = action
        for text, keys, steps in (
            ("&Larger text", "Ctrl++", 1),
            ("&Smaller text", "Ctrl+-", -1),
            ("&Usual text", "Ctrl+0", 0),
        ):
            action = menu.addAction(text)
            action.setShortcuts([QKeySequence(keys), *([QKeySequence("Ctrl+=")] if steps == 1 else [])])
            action.triggered.connect(lambda _, by=steps: self.zoom(by))
        menu.addSeparator()
        end = menu.addAction("&Close")
        end.setShortcut(QKeySequence("Ctrl+Q"))
        end.triggered.connect(self.close)
        self.menuBar().addMenu("&Help").addAction("&Keyboard").triggered.connect(self._show_keys)

    def _restore(self) -> None:
        choice = self._settings.value("theme", SYSTEM)
        choice = choice if choice in CHOICES else SYSTEM
        self.themes[choice].setChecked(True)
        apply_theme(QApplication.instance(), choice)
        size = _number(self._settings.value("text_size"))
        if size is not None:
            self.zoom(round(size - self._usual_size))
        geometry = self._settings.value("geometry")
        if not isinstance(geometry, QByteArray) or not self.restoreGeometry(geometry):
            em = self.fontMetrics().height()
            area = QApplication.primaryScreen().availableGeometry()
            self.resize(min(80 * em, area.width()), min(52 * em, area.height()))
        self.content.restore(_content(self._settings.value("content")))

    def _show_keys(self) -> None:
        rows = (line.split("\t") for line in _KEYS.splitlines())
        table = "".join(f"<tr><td><b>{keys}</b>&nbsp;&nbsp;&nbsp;</td><td>{what}</td></tr>" for keys, what in rows)
        QMessageBox.information(self, "Keyboard", f"<table>{table}</table>")


def main(argv: Sequence[str]) -> int:
    """Opens the window; returns when it was closed.

    :param argv: the program's name and arguments for Qt.
    :returns: the exit status.
    """
    problem = display_problem()
    if problem:
        sys.stderr.write(f"skiros_gui: {problem}\n")
        return NO_DISPLAY
    logging.basicConfig(format="%(levelname)s: %(message)s")
    application = make_application(argv)
    load_plugins("skiros2_gui")
    window = StandaloneWindow(MainWidget(RosSystem), QSettings("skiros2", "window"))
    ends = EndBySignal()
    window.show()
    status = int(application.exec_())
    ends.close()
    _leave_ros()
    return status


def make_application(argv: Sequence[str]) -> QApplication:
    """Returns Qt's application, set up for high-DPI screens. Once per process."""
    for attribute in (Qt.AA_EnableHighDpiScaling, Qt.AA_UseHighDpiPixmaps):
        QApplication.setAttribute(attribute)
    # Text follows the screen in any case; a factor of 1.04, as for 100 dpi, would clip borders.
    QApplication.setHighDpiScaleFactorRoundingPolicy(Qt.HighDpiScaleFactorRoundingPolicy.RoundPreferFloor)
    application = QApplication(list(argv))
    application.setApplicationName("skiros_gui")
    application.setApplicationDisplayName("SkiROS")
    return application


class EndBySignal:
    """Closes the windows on SIGINT and SIGTERM. Python handles signals only while it runs, hence the timer."""

    def __init__(self) -> None:
        self._timer = QTimer()
        self._timer.timeout.connect(lambda: None)
        self._timer.start(_SIGNAL_PERIOD)
        self._handlers = {number: signal.signal(number, self._on_signal) for number in (signal.SIGINT, signal.SIGTERM)}

    def close(self) -> None:
        """Restores the previous handlers."""
        self._timer.stop()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    def _on_signal(self, *_: object) -> None:
        QTimer.singleShot(0, QApplication.closeAllWindows)  # dialogs too


def _leave_ros() -> None:
    """Shuts the node down, if there is one. Does not wait for a master that does not answer."""
    rospy = sys.modules.get("rospy")
    if rospy is None or not rospy.core.is_initialized():
        return
    end = threading.Thread(target=rospy.signal_shutdown, args=("the window was closed",), daemon=True)
    end.start()
    end.join(_SHUTDOWN_TIMEOUT)


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _content(text: Any) -> dict[str, Any]:
    try:
        content = json.loads(text or "{}")
    except (TypeError, ValueError) as error:
        log.warning("the stored settings of the window cannot be read: %s", error)
        return {}
    return content if isinstance(content, dict) else {}
