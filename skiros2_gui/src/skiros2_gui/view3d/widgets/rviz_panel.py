"""The tab with rviz, available if rviz's Python bindings are installed and the platform is X11."""

from __future__ import annotations

import logging
import signal
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QGuiApplication, QHideEvent, QShowEvent
from python_qt_binding.QtWidgets import QDockWidget, QVBoxLayout, QWidget

from skiros2_gui.app.events import ConnectionChanged
from skiros2_gui.app.system import part_of
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button
from skiros2_gui.app.window import Window
from skiros2_live.core.patch import MASTER

log = logging.getLogger(__name__)

#: The configuration, in the package `skiros2`.
CONFIGURATION = "launch/skiros.rviz"

#: rviz cannot register with a restarted master.
_LOST = "The ROS master was down. rviz does not reconnect to a restarted master: close the window and open it again."

_reusable: list[Any] = []


def rviz_problem() -> str:
    """Returns why rviz cannot be embedded here; "" if it can."""
    if find_spec("rviz") is None:
        return "rviz's Python bindings are not installed (Debian: python3-rviz)"
    platform = QGuiApplication.platformName()
    return "" if platform == "xcb" else f"rviz draws on X11 only, and this window is on {platform or 'nothing'}"


class RvizPanel(QWidget):
    """A tab that embeds rviz on request. Starting rviz blocks the window for a second; without a graphics card each
    frame blocks it for some 10 ms.
    """

    title = "3D"
    needs: tuple[str, ...] = (MASTER,)

    def __init__(self, window: Window) -> None:
        super().__init__()
        self._window = window
        self._frame: Any = None
        self._column = QVBoxLayout(self)
        self._column.setContentsMargins(0, 0, 0, 0)
        self._message = PlainLabel(
            "The scene in 3D, drawn by rviz. The element selected in another tab has arrows and rings to move it."
        )
        self._message.setObjectName("rvizSaid")
        self._message.setWordWrap(True)
        self._message.setAlignment(Qt.AlignCenter)
        self._start = push_button("Open rviz here", "rvizOpen", self.open, "It stays until the window is closed")
        self._column.addStretch(1)
        self._column.addWidget(self._message)
        self._column.addWidget(self._start, 0, Qt.AlignHCenter)
        self._column.addStretch(1)
        window.subscribe(ConnectionChanged, lambda _: self._show_state())
        self._show_state()

    @property
    def is_open(self) -> bool:
        """Whether rviz is embedded."""
        return self._frame is not None

    def open(self) -> None:
        """Starts rviz in this tab, unless it is open or cannot be embedded."""
        if self._frame is None and not self._problem():
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
        """Does nothing: rviz is opened on request only."""

    def find(self) -> None:
        """Does nothing: there is no search."""

    def toggle(self) -> None:
        """Starts rviz."""
        self.open()

    def close_tab(self) -> None:
        """Keeps rviz for the next window of this process."""
        if self._frame is not None:
            _keep_for_reuse(self._frame)
            self._frame = None

    def showEvent(self, event: QShowEvent) -> None:
        """Resumes drawing."""
        super().showEvent(event)
        if self._frame is not None:
            self._frame.getManager().startUpdate()

    def hideEvent(self, event: QHideEvent) -> None:
        """Pauses drawing."""
        super().hideEvent(event)
        if self._frame is not None:
            self._frame.getManager().stopUpdate()

    def _problem(self) -> str:
        master = part_of(self._window.tasks.cell, MASTER)
        if master is not None and not master.is_up:
            return "rviz needs the ROS master"
        return rviz_problem()

    def _show_state(self) -> None:
        problem = self._problem()
        if self._frame is not None and problem:
            self._message.setText(_LOST)
            self._column.insertWidget(0, self._message)
            self._message.show()
        elif self._frame is None:
            self._start.setEnabled(not problem)
            self._start.setToolTip(plain_tip(problem or "It stays until the window is closed"))


def _rviz_frame() -> Any:
    """Returns rviz's window as a widget with the project's configuration; reuses one that was kept."""
    if _reusable:
        return _reusable.pop()
    import rospkg
    from rviz import bindings as rviz

    frame = rviz.VisualizationFrame()
    frame.setSplashPath("")
    frame.initialize()
    for number in (signal.SIGINT, signal.SIGTERM):  # rviz has replaced the handlers
        signal.signal(number, signal.getsignal(number))
    reader, config = rviz.YamlConfigReader(), rviz.Config()
    file = Path(rospkg.RosPack().get_path("skiros2")) / CONFIGURATION
    reader.readFile(config, str(file))
    if reader.error():
        log.warning("%s: %s; rviz starts without this configuration", file, reader.errorMessage())
    else:
        frame.load(config)
    frame.setMenuBar(None)
    frame.setStatusBar(None)
    frame.setHideButtonVisibility(True)
    for dock in frame.findChildren(QDockWidget):
        dock.hide()
    return frame


def _keep_for_reuse(frame: Any) -> None:
    """Stops rviz and keeps it for the next window; its destructor would crash the process."""
    from PyQt5 import sip  # rviz's bindings use it, whatever python_qt_binding has chosen

    frame.getManager().stopUpdate()
    frame.hide()
    frame.setParent(None)
    sip.transferto(frame, None)  # so that Python does not destroy it
    _reusable.append(frame)
