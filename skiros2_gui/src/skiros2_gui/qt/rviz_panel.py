"""rviz within the window, where its Python bindings are installed and there is a screen to draw on."""

from __future__ import annotations

import logging
import signal
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QGuiApplication, QHideEvent, QShowEvent
from python_qt_binding.QtWidgets import QDockWidget, QLabel, QPushButton, QVBoxLayout, QWidget

from skiros2_gui.core.events import ConnectionChanged
from skiros2_gui.core.system import MASTER, part_of
from skiros2_gui.core.window import Window

log = logging.getLogger(__name__)

#: What rviz shows at first, in the package `skiros2`.
CONFIGURATION = "launch/skiros.rviz"

#: rviz does not register with another master than the one that it began with.
_LOST = "The ROS master was gone. If it was started anew, rviz does not hear of it: close the window and open it again."

_left_over: list[Any] = []


def rviz_trouble() -> str:
    """Why rviz cannot be a part of the window here, in words; "" where it can."""
    if find_spec("rviz") is None:
        return "rviz's Python bindings are not installed (Debian: python3-rviz)"
    platform = QGuiApplication.platformName()
    return "" if platform == "xcb" else f"rviz draws on X11 only, and this window is on {platform or 'nothing'}"


class RvizPanel(QWidget):
    """A tab with rviz in it, once the user has asked for it: to start it takes a second of the window's thread, and so
    does each picture some 10 ms, where there is no graphics card.
    """

    title = "3D"
    needs: tuple[str, ...] = (MASTER,)

    def __init__(self, window: Window) -> None:
        super().__init__()
        self._window = window
        self._frame: Any = None
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(0, 0, 0, 0)
        self._said = QLabel(
            "The scene in 3D, drawn by rviz. What is selected in another tab has arrows and rings there, to move it."
        )
        self._said.setObjectName("rvizSaid")
        self._said.setWordWrap(True)
        self._said.setAlignment(Qt.AlignCenter)
        self._start = QPushButton("Open rviz here")
        self._start.setObjectName("rvizOpen")
        self._start.setToolTip("It stays until the window is closed")
        self._start.clicked.connect(self.open)
        self._column.addStretch(1)
        self._column.addWidget(self._said)
        self._column.addWidget(self._start, 0, Qt.AlignHCenter)
        self._column.addStretch(1)
        window.subscribe(ConnectionChanged, lambda _: self._show_state())
        self._show_state()

    @property
    def is_open(self) -> bool:
        """Whether rviz is there."""
        return self._frame is not None

    def open(self) -> None:
        """Starts rviz in this tab. Nothing when it is there, or cannot be."""
        if self._frame is None and not self._trouble():
            self._frame = _rviz_frame()
            self._frame.getManager().startUpdate()
            while self._column.count():
                item = self._column.takeAt(0)
                if item.widget() is not None:
                    item.widget().hide()
            self._column.addWidget(self._frame)
            self._frame.show()

    # -- a tab -------------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        return {}

    def restore(self, settings: Mapping[str, Any]) -> None:
        """It is not opened by itself: it takes its time."""

    def find(self) -> None:
        """There is nothing to be found by text."""

    def toggle(self) -> None:
        """Starts rviz; it is not stopped."""
        self.open()

    def close_tab(self) -> None:
        """Lays rviz aside."""
        if self._frame is not None:
            _lay_aside(self._frame)
            self._frame = None

    def showEvent(self, event: QShowEvent) -> None:
        """It is drawn while it is seen."""
        super().showEvent(event)
        if self._frame is not None:
            self._frame.getManager().startUpdate()

    def hideEvent(self, event: QHideEvent) -> None:
        """It is not drawn while it is not seen."""
        super().hideEvent(event)
        if self._frame is not None:
            self._frame.getManager().stopUpdate()

    def _trouble(self) -> str:
        master = part_of(self._window.system, MASTER)
        if master is not None and not master.is_up:
            return "rviz needs the ROS master"
        return rviz_trouble()

    def _show_state(self) -> None:
        trouble = self._trouble()
        if self._frame is not None and trouble:
            self._said.setText(_LOST)
            self._column.insertWidget(0, self._said)
            self._said.show()
        elif self._frame is None:
            self._start.setEnabled(not trouble)
            self._start.setToolTip(trouble or "It stays until the window is closed")


def _rviz_frame() -> Any:
    """rviz's window as a widget, with the project's configuration: one that is left over, or a new one."""
    if _left_over:
        return _left_over.pop()
    import rospkg
    from rviz import bindings as rviz

    frame = rviz.VisualizationFrame()
    frame.setSplashPath("")
    frame.initialize()
    for number in (signal.SIGINT, signal.SIGTERM):  # rviz has taken them
        signal.signal(number, signal.getsignal(number))
    reader, config = rviz.YamlConfigReader(), rviz.Config()
    file = Path(rospkg.RosPack().get_path("skiros2")) / CONFIGURATION
    reader.readFile(config, str(file))
    if reader.error():
        log.warning("%s: %s; rviz shows what it shows without it", file, reader.errorMessage())
    else:
        frame.load(config)
    frame.setMenuBar(None)
    frame.setStatusBar(None)
    frame.setHideButtonVisibility(True)
    for dock in frame.findChildren(QDockWidget):
        dock.hide()
    return frame


def _lay_aside(frame: Any) -> None:
    """Keeps rviz, at rest, for who opens the next window in this process; its destructor would crash the process."""
    from PyQt5 import sip  # which rviz's bindings are made with, whatever python_qt_binding has chosen

    frame.getManager().stopUpdate()
    frame.hide()
    frame.setParent(None)
    sip.transferto(frame, None)  # so that Python does not destroy it at its end
    _left_over.append(frame)
