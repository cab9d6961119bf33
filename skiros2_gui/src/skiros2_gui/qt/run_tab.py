"""The tab "Running": the trees of tasks, live and back in time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from python_qt_binding.QtCore import QByteArray, QEvent, Qt, QTimer
from python_qt_binding.QtWidgets import (
    QLabel,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.core.events import ElementSelected
from skiros2_gui.core.run_presenter import Part, RunPresenter
from skiros2_gui.core.window import Window
from skiros2_gui.qt.run_bar import TreeBar
from skiros2_gui.qt.run_breakpoints import BreakpointPanel
from skiros2_gui.qt.run_details import NodeDetails
from skiros2_gui.qt.run_history_bar import HistoryBar
from skiros2_gui.qt.run_lists import MessageList, TimeList
from skiros2_gui.qt.run_note import TaskNote
from skiros2_gui.qt.run_tasks import TaskPanel
from skiros2_gui.qt.run_view import TreeView

#: After news the tree is drawn so much later, and what stands beside it (ms): news come 25 times a second at most.
_PERIOD, _SLOW_PERIOD = 15, 400

#: How often it is looked whether tasks have gone silent (ms).
_WATCH_PERIOD = 2000


class RunTab(QWidget):
    """The tab; see `qt.tab.Tab`. What is told is drawn at most 25 times a second, and only while the tab is seen."""

    title = "Running"
    needs: tuple[str, ...] = ()

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.presenter = RunPresenter(window)
        self.view = TreeView(self.presenter)
        self._tasks = TaskPanel(self.presenter)
        self._details = NodeDetails()
        self._messages = MessageList()
        self._times = TimeList()
        self._breakpoints = BreakpointPanel(self.presenter)
        self._history = HistoryBar(self.presenter)
        self._note = TaskNote()
        self._bar = TreeBar(self.presenter)
        self._followed = -1
        self._lay_out()
        self._stale = Part.ALL
        self._slow_stale = True
        self._timer = _timer(self, _PERIOD, self._draw)
        self._slow_timer = _timer(self, _SLOW_PERIOD, self._draw_beside)
        self._watch = QTimer(self)
        self._watch.timeout.connect(lambda: self.presenter.check(time.time()))
        self._watch.start(_WATCH_PERIOD)
        self.presenter.on_change = self._on_change
        self._messages.chosen.connect(self._on_message)
        self._times.chosen.connect(lambda node: self._go_to_node(node))
        self._details.element.connect(lambda eid: window.tell(ElementSelected(eid, self)))
        self.view.moved.connect(lambda: self._bar.follow.setChecked(False))
        self._bar.wanted.connect(self._go_to)
        self._bar.fitted.connect(self._fit)
        self._bar.follow.toggled.connect(lambda _: self._on_change(Part.STATES))
        self._on_change(Part.ALL)

    # -- what the main widget asks for -------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        return {
            "sizes": bytes(self._splitter.saveState().toBase64()).decode(),
            "follow": self.presenter.follows,
            "beside": self._beside.currentIndex(),
            "folder": self._tasks.folder,
        }

    def restore(self, settings: Mapping[str, Any]) -> None:
        if isinstance(sizes := settings.get("sizes"), str):
            self._splitter.restoreState(QByteArray.fromBase64(sizes.encode()))
        if isinstance(follow := settings.get("follow"), bool):
            self._bar.follow.setChecked(follow)
        if isinstance(beside := settings.get("beside"), int):
            self._beside.setCurrentIndex(beside)
        if isinstance(folder := settings.get("folder"), str):
            self._tasks.folder = folder

    def find(self) -> None:
        self._bar.focus()

    def toggle(self) -> None:
        self.presenter.toggle()

    def close_tab(self) -> None:
        self._timer.stop()
        self._slow_timer.stop()
        self._watch.stop()
        self.presenter.on_change = lambda part: None

    # -- drawing -----------------------------------------------------------------------------------------------------

    def _on_change(self, part: Part) -> None:
        self._stale |= part
        self._slow_stale = True
        if self.isVisible():
            if not self._timer.isActive():
                self._timer.start()
            if not self._slow_timer.isActive():
                self._slow_timer.start()

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        self._on_change(Part.ALL)
        self._draw()
        self._draw_beside()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.PaletteChange and self.isVisible():
            self._on_change(Part.ALL)

    def hideEvent(self, event: Any) -> None:
        super().hideEvent(event)
        self._timer.stop()
        self._slow_timer.stop()

    def _draw(self) -> None:
        """Draws what has changed since."""
        stale, self._stale = self._stale, Part(0)
        frame = self.presenter.frame
        if stale & Part.TASKS:
            self._tasks.show_tasks()
        if stale & Part.BREAKPOINTS:
            self._breakpoints.show_breakpoints()
        if stale & Part.TREE or not self.view.is_up_to_date():
            self.view.show_tree()
            self._bar.show_tree()
        elif stale & Part.STATES:
            self.view.show_states()
        if stale & (Part.STATES | Part.TREE):
            self._history.show_history()
            self._note.show_task(frame)
            self._follow_running()
        if stale & Part.NODE:
            self._show_node()
        self._empty.setVisible(frame is None)
        self.view.setVisible(frame is not None)

    def _draw_beside(self) -> None:
        """What is read, not watched: a few times a second are enough."""
        if not self._slow_stale:
            return
        self._slow_stale = False
        presenter = self.presenter
        if self._beside.currentWidget() is self._messages:
            self._messages.show_log(presenter.run)
        elif self._beside.currentWidget() is self._times:
            self._times.show_times(presenter)
        elif self._beside.currentWidget() is self._details:
            self._show_node()
            if presenter.is_live:
                presenter.ask_node()
        self._bar.show_running()

    def _show_node(self) -> None:
        frame, place = self.presenter.frame, self.presenter.selected()
        if frame is None or place is None:
            self._details.show_node(None)
        else:
            self._details.show_node(self.presenter.node.text(frame, place))

    def _follow_running(self) -> None:
        if not self.presenter.follows:
            self._followed = -1
        elif self.presenter.is_live:
            running = self.presenter.running()
            if running and running[-1] != self._followed:
                self._followed = running[-1]
                self.view.reveal(running[-1])

    # -- what the user does ------------------------------------------------------------------------------------------

    def _go_to_node(self, node: int) -> None:
        frame = self.presenter.frame
        place = frame.shape.places.get(node) if frame is not None else None
        if place is not None:
            self.presenter.select(place)
            self._go_to(place)

    def _on_message(self, line: Any) -> None:
        """A message leads to its node at that time."""
        self.presenter.go_to_time(line.time)
        self._draw()
        self._go_to_node(line.node)

    def _fit(self) -> None:
        self._draw()
        self.view.fit()

    def _go_to(self, place: int | None) -> None:
        if place is not None:
            self._draw()
            self.view.reveal(place)

    # -- widgets -----------------------------------------------------------------------------------------------------

    def _lay_out(self) -> None:
        self._empty = QLabel("No task has run yet.\nStart a skill, or open a recorded run.")
        self._empty.setAlignment(Qt.AlignCenter)
        self._empty.setEnabled(False)
        middle = QWidget()
        column = QVBoxLayout(middle)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self._bar)
        column.addWidget(self._note)
        column.addWidget(self._empty, 1)
        column.addWidget(self.view, 1)
        self._beside = QTabWidget()
        self._beside.setObjectName("runBeside")
        self._beside.setDocumentMode(True)
        for widget, title in (
            (self._details, "Node"),
            (self._messages, "Messages"),
            (self._times, "Times"),
            (self._breakpoints, "Breakpoints"),
        ):
            self._beside.addTab(widget, title)
        self._beside.currentChanged.connect(lambda _: self._on_beside())
        self._splitter = QSplitter(Qt.Horizontal)
        for widget, stretch, least in ((self._tasks, 0, 110), (middle, 1, 240), (self._beside, 0, 160)):
            widget.setMinimumWidth(least)
            self._splitter.addWidget(widget)
            self._splitter.setStretchFactor(self._splitter.count() - 1, stretch)
        self._splitter.setSizes([260, 630, self._beside.tabBar().sizeHint().width() + 4])
        self._splitter.setChildrenCollapsible(True)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.setSpacing(0)
        whole.addWidget(self._splitter, 1)
        whole.addWidget(self._history)

    def _on_beside(self) -> None:
        self._slow_stale = True
        self._draw_beside()
        if self._beside.currentWidget() is self._breakpoints:
            self.presenter.breakpoints.ask(self.presenter.robot)


def _timer(parent: QWidget, period: int, call: Any) -> QTimer:
    """Calls once, that long after it was started (ms)."""
    timer = QTimer(parent)
    timer.setSingleShot(True)
    timer.setInterval(period)
    timer.timeout.connect(call)
    return timer
