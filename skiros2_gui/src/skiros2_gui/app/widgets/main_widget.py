"""The content of the window, the same in rqt and standalone: tabs, error bar, status line."""

from __future__ import annotations

import gc
import logging
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol

from python_qt_binding.QtCore import QEvent, QObject, Qt, QTimer, Signal
from python_qt_binding.QtGui import QKeySequence
from python_qt_binding.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLineEdit,
    QPlainTextEdit,
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
    TaskStarted,
    WorldChanged,
)
from skiros2_gui.app.jobs import Jobs
from skiros2_gui.app.next_step import ADD, LOAD
from skiros2_gui.app.problems import ExceptHook, Problems
from skiros2_gui.app.system import System, missing, parts_of
from skiros2_gui.app.widgets.collector import Collector
from skiros2_gui.app.widgets.controls import SPACE_TOGGLES, text_label
from skiros2_gui.app.widgets.next_step_bar import NextStepBar
from skiros2_gui.app.widgets.status import ErrorBar, StatusLine
from skiros2_gui.app.widgets.stop_bar import StopBar
from skiros2_gui.app.widgets.stop_control import StopControl, TallTabBar
from skiros2_gui.app.widgets.theme import is_dark, tint
from skiros2_gui.app.window import Window
from skiros2_gui.approvals.widgets.dialog import ApprovalsButton
from skiros2_gui.learning.widgets.tab import LearningTab
from skiros2_gui.run.widgets.tab import RunTab
from skiros2_gui.skills.widgets.tab import SkillsTab
from skiros2_gui.view3d.widgets.rviz_panel import RvizPanel, rviz_problem
from skiros2_gui.world.widgets.tab import WorldTab

#: The shortest time between two batches of events (ms): 25 Hz.
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


#: The user moved the focus.
_CHOSEN = (Qt.MouseFocusReason, Qt.ShortcutFocusReason)

#: The focus returns to the widget that had it.
_RETURNED = (Qt.ActiveWindowFocusReason, Qt.PopupFocusReason, Qt.MenuBarFocusReason)

_TAB_KEYS = (Qt.Key_Tab, Qt.Key_Backtab)


class FocusTracker:
    """Follows the events of the application.

    When the focus widget is disabled or hidden, Qt moves the focus to the next widget, where the user does not expect
    to write. A widget counts as entered after a click into it, after the Tab key or a shortcut that led to it, when it
    edits a cell of a list, and as soon as a key other than the space bar is pressed in it.

    :ivar is_entered: whether the user entered the focus widget.
    """

    def __init__(self) -> None:
        self.is_entered = False
        self._is_tab_down = False

    def track(self, watched: QObject, event: QEvent) -> None:
        """Processes an event before `watched` gets it."""
        kind = event.type()
        if kind == QEvent.KeyPress:
            self._is_tab_down = event.key() in _TAB_KEYS
            if event.key() != Qt.Key_Space and watched is QApplication.focusWidget():
                self.is_entered = True
        elif kind == QEvent.KeyRelease:
            self._is_tab_down = False
        elif kind == QEvent.FocusIn and isinstance(watched, QWidget):
            if event.reason() not in _RETURNED:
                self.is_entered = event.reason() in _CHOSEN or self._is_tab_down or _edits_cell(watched)
        elif kind == QEvent.MouseButtonPress and isinstance(watched, QWidget):
            focus = QApplication.focusWidget()
            if focus is not None and (focus is watched or focus.isAncestorOf(watched)):
                self.is_entered = True


def _edits_cell(widget: QWidget) -> bool:
    viewport = widget.parentWidget()
    return viewport is not None and isinstance(viewport.parentWidget(), QAbstractItemView)


log = logging.getLogger(__name__)

#: The tabs before and after rviz, which is there where it is available.
TABS: tuple[type[Any], ...] = (SkillsTab, RunTab, WorldTab)
LAST_TABS: tuple[type[Any], ...] = (LearningTab,)

#: Widgets that handle the space bar.
_EDITORS = (QLineEdit, QTextEdit, QPlainTextEdit, QComboBox, QAbstractSpinBox, QAbstractButton)

#: Shown if the program continues without its node (rqt).
_NODE_ENDED = "ROS has shut down this program's node, and the window no longer works; open it again"


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
        self._collector = Collector(self)
        self._bridge = Bridge()
        self.system = connect(self._bridge.event_queue)
        self.shared = Window(self.system, self._bridge.jobs, self._bridge.problems, self._bridge.event_queue)
        self.shared.subscribe(ElementSelected, lambda event: self.system.set_movable(event.eid))
        self.shared.subscribe(ProblemReported, lambda event: self.shared.problems.report(event.activity, event.text))
        self.shared.subscribe(TaskStarted, self._task_started)
        self.shared.subscribe(NodeShutdown, lambda event: self.shared.problems.report(_NODE_ENDED, event.reason))
        self.tabs = QTabWidget()
        self.tabs.setTabBar(TallTabBar())
        self.tabs.setDocumentMode(True)
        tabs = (*TABS, *(() if rviz_problem() else (RvizPanel,)), *LAST_TABS)
        self.pages = [_Page(tab(self.shared), self.shared) for tab in tabs]
        for number, page in enumerate(self.pages):
            self.tabs.addTab(page, page.tab.title)
            self.tabs.setTabToolTip(number, f"{page.tab.title} (Alt+{number + 1})")
            self._on_keys(QKeySequence(f"Alt+{number + 1}"), partial(self.tabs.setCurrentIndex, number))
        self.stop_control = StopControl(self.shared)
        self.tabs.setCornerWidget(self.stop_control)
        # Dialogs, open lists and cells that are being edited take Esc before it is a shortcut.
        self.stop_keys = [self._on_keys(QKeySequence(keys), self.stop_control.stop) for keys in ("Esc", "Ctrl+.")]
        self._on_keys(QKeySequence(QKeySequence.Find), lambda: self.tab.find())
        self.error_bar = ErrorBar(self.shared.problems)
        self.status = StatusLine(self.shared)
        self.approvals = ApprovalsButton(self.shared, self)
        self.status.add(self.approvals)
        self.stop_bar = StopBar(self.shared)
        calls = {LOAD: partial(self._in_world_tab, WorldTab.load), ADD: partial(self._in_world_tab, WorldTab.add)}
        self.next_step = NextStepBar(self.shared, calls)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.stop_bar)
        column.addWidget(self.next_step)
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

    def _in_world_tab(self, call: Callable[[WorldTab], None]) -> None:
        """Opens the tab "World model" and calls one of its methods."""
        number = TABS.index(WorldTab)
        self.tabs.setCurrentIndex(number)
        call(self.pages[number].tab)

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
        self._collector.close()
        self.stop_control.close_timer()
        self.next_step.close_timer()
        self.approvals.close_timer()
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

    def _on_keys(self, keys: QKeySequence, call: Callable[[], None]) -> QShortcut:
        shortcut = QShortcut(keys, self, call, context=Qt.WidgetWithChildrenShortcut)
        shortcut.setAutoRepeat(False)
        return shortcut

    def _set_colours(self) -> None:
        dark = is_dark(self)
        if dark != self._is_dark:
            self._is_dark = dark
            for page in self.pages:
                tint(page.banner, background="notice", dark=dark)
            self.error_bar.set_dark(dark)
            self.stop_bar.set_dark(dark)
            self.next_step.set_dark(dark)
            self.status.set_dark(dark)

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
        self.banner = text_label("banner", is_selectable=False)
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
        text = missing(parts_of(self._window.tasks.cell), self.tab.needs)
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
