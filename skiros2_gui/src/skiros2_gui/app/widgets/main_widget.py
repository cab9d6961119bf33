"""The content of the window, the same in rqt and standalone: tabs, error bar, status line."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from python_qt_binding.QtCore import QEvent, QObject, Qt
from python_qt_binding.QtGui import QKeySequence
from python_qt_binding.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QPushButton,
    QShortcut,
    QTabWidget,
    QTextEdit,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_gui.app.events import (
    ConnectionChanged,
    ElementSelected,
    EventQueue,
    ManagersChanged,
    NodeShutdown,
    ProblemReported,
    StopRequested,
    TaskStarted,
    WorldChanged,
)
from skiros2_gui.app.problems import ExceptHook
from skiros2_gui.app.system import System, missing
from skiros2_gui.app.widgets.bridge import Bridge
from skiros2_gui.app.widgets.focus_tracker import SPACE_TOGGLES, FocusTracker
from skiros2_gui.app.widgets.status import ErrorBar, StatusLine
from skiros2_gui.app.widgets.theme import is_dark, tint
from skiros2_gui.app.window import Window
from skiros2_gui.run.widgets.tab import RunTab
from skiros2_gui.skills.widgets.tab import SkillsTab
from skiros2_gui.view3d.widgets.rviz_panel import RvizPanel, rviz_problem
from skiros2_gui.world.widgets.tab import WorldTab

log = logging.getLogger(__name__)

#: The tabs; rviz follows where it is available.
TABS: tuple[type[Any], ...] = (SkillsTab, RunTab, WorldTab)

#: Widgets that handle the space bar.
_EDITORS = (QLineEdit, QTextEdit, QPlainTextEdit, QComboBox, QAbstractSpinBox, QAbstractButton)

#: Shown if the program continues without its node (rqt).
_NODE_ENDED = "ROS has shut down this program's node, and the window does not work any more; open it again"


class Tab(Protocol):
    """A widget for one tab; constructed with the `Window`."""

    #: The text of the tab.
    title: str
    #: The kinds of parts (`app.system`) it requires; it is disabled while one is missing.
    needs: tuple[str, ...]

    def settings(self) -> dict[str, Any]:
        """Returns the settings to store, as JSON values."""

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Restores settings; they may come from another version or have been edited."""

    def find(self) -> None:
        """Ctrl+F: gives the focus to the search."""

    def toggle(self) -> None:
        """The space bar outside of editors: starts or stops the tab's task, if it has one."""

    def close_tab(self) -> None:
        """Stops all timers and threads: the window closes."""


class MainWidget(QWidget):
    """The content of the window.

    :param connect: makes the system, given the queue for its events.
    """

    def __init__(self, connect: Callable[[EventQueue], System], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("skiros")
        self.setWindowTitle("SkiROS")
        self._bridge = Bridge()
        self.system = connect(self._bridge.event_queue)
        self.shared = Window(self.system, self._bridge.jobs, self._bridge.problems, self._bridge.event_queue)
        self.shared.subscribe(ElementSelected, lambda event: self.system.set_movable(event.eid))
        self.shared.subscribe(ProblemReported, lambda event: self.shared.problems.report(event.activity, event.text))
        self.shared.subscribe(TaskStarted, self._task_started)
        self.shared.subscribe(NodeShutdown, lambda event: self.shared.problems.report(_NODE_ENDED, event.reason))
        self.tabs = QTabWidget()
        self.tabs.setDocumentMode(True)
        tabs = TABS if rviz_problem() else (*TABS, RvizPanel)
        self.pages = [_Page(tab(self.shared), self.shared) for tab in tabs]
        for number, page in enumerate(self.pages):
            self.tabs.addTab(page, page.tab.title)
            self.tabs.setTabToolTip(number, f"{page.tab.title} (Alt+{number + 1})")
            self._on_keys(QKeySequence(f"Alt+{number + 1}"), partial(self.tabs.setCurrentIndex, number))
        self.stop = QPushButton("■ Stop all")
        self.stop.setObjectName("stopAllButton")
        self.stop.setToolTip("Stops all tasks of all robots, and the goal  (Ctrl+.)")
        self.stop.clicked.connect(lambda: self.shared.publish(StopRequested()))
        self.tabs.setCornerWidget(self.stop)
        self._on_keys(QKeySequence("Ctrl+."), self.stop.click)
        self._on_keys(QKeySequence(QKeySequence.Find), lambda: self.tab.find())
        self.error_bar = ErrorBar(self.shared.problems)
        self.status = StatusLine(self.shared)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.tabs, 1)
        column.addWidget(self.error_bar)
        column.addWidget(self.status)
        self._focus = FocusTracker()
        QApplication.instance().installEventFilter(self)
        self._is_closed = False
        self._is_dark: bool | None = None
        self._set_colours()
        self._excepthook = ExceptHook(self.shared.problems)
        self.shared.subscribe(WorldChanged, _spare_collector)  # last, after the tabs have built their data
        self._bridge.attach(self.shared)

    def _task_started(self, event: TaskStarted) -> None:
        if event.to_front:
            self.tabs.setCurrentIndex(TABS.index(RunTab))

    @property
    def tab(self) -> Tab:
        """The current tab."""
        return self.pages[self.tabs.currentIndex()].tab

    def settings(self) -> dict[str, Any]:
        """Returns the settings to store, as JSON values."""
        return {
            "tab": self.tab.title,
            "tabs": {page.tab.title: page.tab.settings() for page in self.pages},
        }

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Restores settings; invalid values are skipped and reported."""
        of_tabs = settings.get("tabs")
        for index, page in enumerate(self.pages):
            title = page.tab.title
            if settings.get("tab") == title:
                self.tabs.setCurrentIndex(index)
            known = of_tabs.get(title) if isinstance(of_tabs, Mapping) else None
            if isinstance(known, Mapping):
                try:
                    page.tab.restore(known)
                except (TypeError, ValueError, LookupError, AttributeError) as error:
                    self.shared.problems.report(f"restoring the settings of {title}", error)

    def shut_down(self) -> None:
        """Closes the tabs and the system. Does not wait for running calls."""
        if self._is_closed:
            return
        self._is_closed = True
        QApplication.instance().removeEventFilter(self)
        self._excepthook.close()
        self._bridge.close()
        for page in self.pages:
            try:
                page.tab.close_tab()
            except FOREIGN_ERRORS:  # the others are closed nevertheless
                log.exception("closing the tab %s failed", page.tab.title)
        self.system.close()

    def changeEvent(self, event: QEvent) -> None:
        """Follows changes of the palette."""
        if event.type() == QEvent.PaletteChange:
            self._set_colours()
        super().changeEvent(event)

    def _on_keys(self, keys: QKeySequence, call: Callable[[], None]) -> None:
        QShortcut(keys, self, call, context=Qt.WidgetWithChildrenShortcut)

    def _set_colours(self) -> None:
        dark = is_dark(self)
        if dark != self._is_dark:
            self._is_dark = dark
            for page in self.pages:
                tint(page.banner, background="notice", dark=dark)
            self.error_bar.set_dark(dark)
            self.status.set_dark(dark)
            tint(self.stop, text="failure", dark=dark)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Lets the space bar toggle the tab's task, unless the user has entered a widget that handles the space bar."""
        if event.type() == QEvent.KeyPress and event.key() == Qt.Key_Space and event.modifiers() == Qt.NoModifier:
            focus = QApplication.focusWidget()
            is_here = focus is not None and self.isAncestorOf(focus)
            if is_here and watched is focus and not (_takes_space(focus) and self._focus.is_entered):
                if not event.isAutoRepeat():
                    self.tab.toggle()
                return True
        self._focus.track(watched, event)
        return super().eventFilter(watched, event)


class _Page(QWidget):
    """A tab, and a banner above it if a required part of the system is missing."""

    def __init__(self, tab: Any, window: Window) -> None:
        super().__init__()
        self.tab = tab
        self._window = window
        self.banner = QLabel()
        self.banner.setObjectName("banner")
        self.banner.setTextFormat(Qt.PlainText)
        self.banner.setWordWrap(True)
        self.banner.setMargin(6)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.banner)
        column.addWidget(tab, 1)
        window.subscribe(ConnectionChanged, lambda _: self._show())
        window.subscribe(ManagersChanged, lambda _: self._show())
        self._show()

    def _show(self) -> None:
        text = missing(self._window.system.parts, self.tab.needs)
        self.banner.setText(text)
        self.banner.setVisible(bool(text))
        self.tab.setEnabled(not text or not self.tab.needs)


def _spare_collector(event: WorldChanged) -> None:
    """Exempts a loaded scene from garbage collection, whose passes over it would take 50 ms and more. Reference
    counting still frees it.
    """
    if event.is_reset:
        gc.freeze()


def _takes_space(focus: QWidget) -> bool:
    if focus.property(SPACE_TOGGLES):
        return False
    if isinstance(focus, QAbstractItemView):
        return focus.state() == QAbstractItemView.EditingState
    return isinstance(focus, _EDITORS)
