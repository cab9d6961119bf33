"""The window's content, the same in rqt and by itself: the tabs, what is up, and what went wrong."""

from __future__ import annotations

import gc
import logging
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

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
    QShortcut,
    QTabWidget,
    QTextEdit,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_gui.core.events import (
    ConnectionChanged,
    ElementSelected,
    ManagersChanged,
    NodeEnded,
    ProblemHeard,
    TaskStarted,
    WorldChanged,
)
from skiros2_gui.core.health import missing
from skiros2_gui.core.inbox import Inbox
from skiros2_gui.core.system import System
from skiros2_gui.core.window import Window
from skiros2_gui.qt.bridge import Bridge
from skiros2_gui.qt.entry import SPACE_TOGGLES, Entry
from skiros2_gui.qt.error_bar import ErrorBar
from skiros2_gui.qt.mishaps import Mishaps
from skiros2_gui.qt.run_tab import RunTab
from skiros2_gui.qt.rviz_panel import RvizPanel, rviz_trouble
from skiros2_gui.qt.skills_tab import SkillsTab
from skiros2_gui.qt.status_line import StatusLine
from skiros2_gui.qt.tab import Tab
from skiros2_gui.qt.theme import is_dark, tint
from skiros2_gui.qt.world_tab import WorldTab

log = logging.getLogger(__name__)

#: The tabs, in their order; after them rviz, where it can be drawn.
TABS: tuple[type[Any], ...] = (SkillsTab, RunTab, WorldTab)

#: Where the space bar has a meaning of its own.
_EDITORS = (QLineEdit, QTextEdit, QPlainTextEdit, QComboBox, QAbstractSpinBox, QAbstractButton)

#: Of a node that was told to end, in a program that goes on (rqt).
_NODE_ENDED = "ROS has ended this program's node, so that nothing is shown or done any more; open it anew"


class MainWidget(QWidget):
    """The one widget of the window.

    :param connect: makes the connection to the system, given the inbox for what is heard of it.
    """

    def __init__(self, connect: Callable[[Inbox], System], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("skiros")
        self.setWindowTitle("SkiROS")
        self._bridge = Bridge()
        self.system = connect(self._bridge.inbox)
        self.shared = Window(self.system, self._bridge.jobs, self._bridge.problems, self._bridge.inbox)
        self.shared.subscribe(ElementSelected, lambda event: self.system.mark(event.eid))
        self.shared.subscribe(ProblemHeard, lambda event: self.shared.problems.tell(event.what, event.text))
        self.shared.subscribe(TaskStarted, self._task_started)
        self.shared.subscribe(NodeEnded, lambda event: self.shared.problems.tell(_NODE_ENDED, event.reason))
        self.tabs = QTabWidget()
        self.tabs.setDocumentMode(True)
        tabs = TABS if rviz_trouble() else (*TABS, RvizPanel)
        self.pages = [_Page(made(self.shared), self.shared) for made in tabs]
        for number, page in enumerate(self.pages):
            self.tabs.addTab(page, page.tab.title)
            self.tabs.setTabToolTip(number, f"{page.tab.title} (Alt+{number + 1})")
            self._on_keys(QKeySequence(f"Alt+{number + 1}"), partial(self.tabs.setCurrentIndex, number))
        self._on_keys(QKeySequence(QKeySequence.Find), lambda: self.tab.find())
        self.error_bar = ErrorBar(self.shared.problems)
        self.status = StatusLine(self.shared)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.tabs, 1)
        column.addWidget(self.error_bar)
        column.addWidget(self.status)
        self._entry = Entry()
        QApplication.instance().installEventFilter(self)
        self._is_closed = False
        self._is_dark: bool | None = None
        self._set_colours()
        self._mishaps = Mishaps(self.shared.problems)
        self.shared.subscribe(WorldChanged, _spare_collector)  # last, when the tabs have made what they need of it
        self._bridge.attach(self.shared)

    def _task_started(self, event: TaskStarted) -> None:
        if event.to_front:
            self.tabs.setCurrentIndex(TABS.index(RunTab))

    @property
    def tab(self) -> Tab:
        """The tab that is shown."""
        return self.pages[self.tabs.currentIndex()].tab

    def settings(self) -> dict[str, Any]:
        """What is to be the same the next time, as JSON has it."""
        return {
            "tab": self.tab.title,
            "tabs": {page.tab.title: page.tab.settings() for page in self.pages},
        }

    def restore(self, settings: Mapping[str, Any]) -> None:
        """Takes what `settings` gave some time; what cannot be used of it is left, and said."""
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
                    self.shared.problems.tell(f"restoring the settings of {title}", error)

    def shut_down(self) -> None:
        """Ends all that the window has going on. It does not wait for calls that are under way."""
        if self._is_closed:
            return
        self._is_closed = True
        QApplication.instance().removeEventFilter(self)
        self._mishaps.close()
        self._bridge.close()
        for page in self.pages:
            try:
                page.tab.close_tab()
            except FOREIGN_ERRORS:  # the others are to end all the same
                log.exception("closing %s", page.tab.title)
        self.system.close()

    def changeEvent(self, event: QEvent) -> None:
        """The colours follow the palette: that of rqt, of the desktop, or of the window's own menu."""
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

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The space bar starts and stops, where the focus is not in something that takes it itself and that the user
        has entered."""
        if event.type() == QEvent.KeyPress and event.key() == Qt.Key_Space and event.modifiers() == Qt.NoModifier:
            focus = QApplication.focusWidget()
            is_here = focus is not None and self.isAncestorOf(focus)
            if is_here and watched is focus and not (_takes_space(focus) and self._entry.is_entered):
                if not event.isAutoRepeat():
                    self.tab.toggle()
                return True
        self._entry.note(watched, event)
        return super().eventFilter(watched, event)


class _Page(QWidget):
    """A tab, and above it a line when something is missing that it needs."""

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
    """What has just been loaded lives long: Python's collector is not to look through all of it again and again, which
    takes 50 ms and more at a time. What nothing refers to any more is freed all the same."""
    if event.is_new:
        gc.freeze()


def _takes_space(focus: QWidget) -> bool:
    if focus.property(SPACE_TOGGLES):
        return False
    if isinstance(focus, QAbstractItemView):
        return focus.state() == QAbstractItemView.EditingState
    return isinstance(focus, _EDITORS)
