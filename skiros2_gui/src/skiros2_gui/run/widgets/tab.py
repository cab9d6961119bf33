"""The tab "Running"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from python_qt_binding.QtCore import QByteArray, QEvent, Qt
from python_qt_binding.QtWidgets import QFileDialog, QSplitter, QTabWidget, QVBoxLayout, QWidget

from skiros2_common.core.forward_clock import now
from skiros2_gui.app.events import ElementSelected
from skiros2_gui.app.names import Names
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label, timer
from skiros2_gui.app.widgets.task_table import TaskTable
from skiros2_gui.app.widgets.theme import is_dark, tint
from skiros2_gui.app.window import Window
from skiros2_gui.run.presenter import Redraw, RunPresenter
from skiros2_gui.run.widgets.bars import HistoryBar, TreeBar
from skiros2_gui.run.widgets.side_tabs import BreakpointPanel, MessageList, NodeDetails, TimeList
from skiros2_gui.run.widgets.signals import SignalPanel
from skiros2_gui.run.widgets.view import TreeView
from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import FAILURE
from skiros2_skill.core.runtime.history import one_line

#: The most characters shown in the banner (of the first line), and in its tooltip.
_LONGEST, _LONGEST_TIP = 240, 2000

#: The delay after an event before drawing the tree, and the side tabs (ms). Events come at up to 25 Hz.
_PERIOD, _SLOW_PERIOD = 15, 400

#: The period of checks for tasks without progress (ms).
_WATCH_PERIOD = 2000


class RunTab(QWidget):
    """See `app.widgets.main_widget.Tab`. Draws at most 25 times a second, and only while visible."""

    title = "Running"
    needs: tuple[str, ...] = ()

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.presenter = RunPresenter(window)
        self.view = TreeView(self.presenter)
        self._folder = ""
        self._window_tasks = window.tasks
        self._tasks = TaskTable(window, "taskChoice", lambda: self.presenter.runs, lambda: self.presenter.run)
        self._tasks.picked.connect(self.presenter.pick)
        self._names = Names(window.system)
        self._details = NodeDetails(self._names)
        self._messages = MessageList(self._names)
        self._times = TimeList()
        self._breakpoints = BreakpointPanel(self.presenter)
        self._signals = SignalPanel(window, self.presenter)
        self._history = HistoryBar(self.presenter)
        self._bar = TreeBar(self.presenter)
        self._followed = -1
        self._lay_out()
        self._stale = Redraw.ALL
        self._slow_stale = True
        self._timer = timer(self, _PERIOD, self._draw)
        self._slow_timer = timer(self, _SLOW_PERIOD, self._draw_side_tabs)
        self._watch = timer(self, _WATCH_PERIOD, lambda: window.tasks.check(now()), repeats=True)
        self._watch.start()
        self.presenter.on_change = self._on_change
        self._messages.picked.connect(self._on_message)
        self._times.picked.connect(self._go_to_node)
        self._details.element.connect(lambda eid: window.publish(ElementSelected(eid, self)))
        self.view.moved.connect(lambda: self._bar.follow.setChecked(False))
        self._bar.reveal_requested.connect(self._go_to)
        self._bar.fit_requested.connect(self._fit)
        self._bar.follow.toggled.connect(lambda _: self._on_change(Redraw.STATES))
        self._on_change(Redraw.ALL)

    # -- Tab ----------------------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        return {
            "sizes": bytes(self._splitter.saveState().toBase64()).decode(),
            "follow": self.presenter.follows,
            "beside": self._side_tabs.currentIndex(),
            "folder": self._folder,
            "signal_span": self._signals.plots.span,
        }

    def restore(self, settings: Mapping[str, Any]) -> None:
        if isinstance(sizes := settings.get("sizes"), str):
            self._splitter.restoreState(QByteArray.fromBase64(sizes.encode()))
        if isinstance(follow := settings.get("follow"), bool):
            self._bar.follow.setChecked(follow)
        if isinstance(beside := settings.get("beside"), int):
            self._side_tabs.setCurrentIndex(beside)
        if isinstance(folder := settings.get("folder"), str):
            self._folder = folder
        if isinstance(span := settings.get("signal_span"), float):
            self._signals.set_span(span)

    def find(self) -> None:
        self._bar.focus()

    def toggle(self) -> None:
        self.presenter.toggle()

    @property
    def is_drawn(self) -> bool:
        """Whether no change waits to be drawn."""
        return not self._stale

    def close_tab(self) -> None:
        self._timer.stop()
        self._slow_timer.stop()
        self._watch.stop()
        self._tasks.close_timers()
        self._signals.shut_down()
        self.presenter.on_change = lambda part: None

    # -- drawing -----------------------------------------------------------------------------------------------------

    def _on_change(self, part: Redraw) -> None:
        self._stale |= part
        self._slow_stale = True
        if self.isVisible():
            if not self._timer.isActive():
                self._timer.start()
            if not self._slow_timer.isActive():
                self._slow_timer.start()

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        self._on_change(Redraw.ALL)
        self._draw()
        self._draw_side_tabs()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.PaletteChange and self.isVisible():
            self._on_change(Redraw.ALL)

    def hideEvent(self, event: Any) -> None:
        super().hideEvent(event)
        self._timer.stop()
        self._slow_timer.stop()

    def _draw(self) -> None:
        """Draws the pending changes."""
        stale, self._stale = self._stale, Redraw(0)
        frame = self.presenter.frame
        if stale & Redraw.TASKS:
            self._show_source()
            self._tasks.show_tasks()
        if stale & Redraw.BREAKPOINTS:
            self._breakpoints.show_breakpoints()
        if stale & Redraw.TREE or not self.view.is_up_to_date():
            self.view.show_tree()
            self._bar.show_tree()
        elif stale & Redraw.STATES:
            self.view.show_states()
        if stale & (Redraw.STATES | Redraw.TREE):
            self._history.show_history()
            self._show_banner(frame)
            self._follow_running()
        if stale & Redraw.NODE:
            self._show_node()
        self._empty.setVisible(frame is None)
        self.view.setVisible(frame is not None)

    def _draw_side_tabs(self) -> None:
        """Draws the current side tab, at a lower rate."""
        if not self._slow_stale:
            return
        self._slow_stale = False
        presenter = self.presenter
        if self._side_tabs.currentWidget() is self._messages:
            self._messages.show_log(presenter.run)
        elif self._side_tabs.currentWidget() is self._times:
            self._times.show_times(presenter)
        elif self._side_tabs.currentWidget() is self._details:
            self._show_node()
            if presenter.is_live:
                presenter.ask_node()
        self._bar.show_running()

    def _show_node(self) -> None:
        index = self.presenter.selected_index()
        self._details.show_node(self.presenter.node_text(index) if index is not None else None)

    def _follow_running(self) -> None:
        if not self.presenter.follows:
            self._followed = -1
        elif self.presenter.is_live:
            running = self.presenter.running()
            if running and running[-1] != self._followed:
                self._followed = running[-1]
                self.view.reveal(running[-1])

    def _show_banner(self, frame: Frame | None) -> None:
        """Shows the message of the root while the task is paused or after it has failed."""
        whole = frame.message(0).strip() if frame is not None and len(frame.shape) else ""
        line = one_line(whole)
        has_failed = frame is not None and bool(line) and frame.state(0) == FAILURE
        if frame is not None and frame.has_ended and not has_failed:
            line = ""
        cause = self._window_tasks.cause(self.presenter.run) if self.presenter.run is not None else ""
        line = cause if cause and frame is not None and frame.has_ended else self._names.readable(line)
        text = line if len(line) <= _LONGEST else f"{line[: _LONGEST - 1]}…"
        if text != self._banner.text():
            self._banner.setText(text)
            self._banner.setToolTip(plain_tip(whole[:_LONGEST_TIP] if text != whole else ""))
        tint(self._banner, background="error" if has_failed else "notice", dark=is_dark(self))
        self._banner.setVisible(bool(text))

    def _show_source(self) -> None:
        bag = self.presenter.bag
        self._source.setText(f"Tasks of {bag.path.rpartition('/')[2]}" if bag is not None else "Tasks of all robots")
        self._source.setToolTip(plain_tip(bag.path if bag is not None else ""))
        self._bag_button.setText("Close bag" if bag is not None else "Open bag…")

    # -- what the user does ------------------------------------------------------------------------------------------

    def _go_to_node(self, node: int) -> None:
        frame = self.presenter.frame
        index = frame.shape.index_by_id.get(node) if frame is not None else None
        if index is not None:
            self.presenter.select(index)
            self._go_to(index)

    def _on_message(self, line: Any) -> None:
        """Goes to the node and the time of a message."""
        self.presenter.go_to_time(line.time)
        self._draw()
        self._go_to_node(line.node)

    def _on_bag(self) -> None:
        if self.presenter.bag is not None:
            self.presenter.close_bag()
            return
        path, _ = QFileDialog.getOpenFileName(self, "Open a recorded run", self._folder, "Bags (*.bag);;All files (*)")
        if path:
            self._folder = path.rpartition("/")[0]
            self.presenter.open_bag(path)

    def _fit(self) -> None:
        self._draw()
        self.view.fit()

    def _go_to(self, index: int | None) -> None:
        if index is not None:
            self._draw()
            self.view.reveal(index)

    # -- widgets -----------------------------------------------------------------------------------------------------

    def _lay_out(self) -> None:
        self._empty = PlainLabel("No task has run yet.\nStart a skill, or open a recorded run.")
        self._empty.setObjectName("noTask")
        self._empty.setAlignment(Qt.AlignCenter)
        self._empty.setEnabled(False)
        self._source = text_label("", is_selectable=False)
        self._bag_button = push_button("", "openBag", self._on_bag, "show the tasks of a recorded run")
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self._source)
        column.addWidget(self._tasks, 1)
        column.addWidget(self._bag_button, 0, Qt.AlignLeft)
        self._banner = text_label("taskNote")
        self._banner.setMargin(6)
        self._banner.hide()
        middle = QWidget()
        column = QVBoxLayout(middle)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self._bar)
        column.addWidget(self._banner)
        column.addWidget(self._empty, 1)
        column.addWidget(self.view, 1)
        self._side_tabs = QTabWidget()
        self._side_tabs.setObjectName("runBeside")
        self._side_tabs.setDocumentMode(True)
        for widget, title in (
            (self._details, "Node"),
            (self._messages, "Messages"),
            (self._times, "Times"),
            (self._breakpoints, "Breakpoints"),
            (self._signals, "Signals"),
        ):
            self._side_tabs.addTab(widget, title)
        self._side_tabs.currentChanged.connect(lambda _: self._on_side_tab())
        self._splitter = QSplitter(Qt.Horizontal)
        for widget, stretch, least in ((left, 0, 110), (middle, 1, 240), (self._side_tabs, 0, 160)):
            widget.setMinimumWidth(least)
            self._splitter.addWidget(widget)
            self._splitter.setStretchFactor(self._splitter.count() - 1, stretch)
        self._splitter.setSizes([260, 630, self._side_tabs.tabBar().sizeHint().width() + 4])
        self._splitter.setChildrenCollapsible(True)
        whole = QVBoxLayout(self)
        whole.setContentsMargins(0, 0, 0, 0)
        whole.setSpacing(0)
        whole.addWidget(self._splitter, 1)
        whole.addWidget(self._history)

    def _on_side_tab(self) -> None:
        self._slow_stale = True
        self._draw_side_tabs()
        if self._side_tabs.currentWidget() is self._breakpoints:
            self.presenter.breakpoints.ask(self.presenter.robot)
