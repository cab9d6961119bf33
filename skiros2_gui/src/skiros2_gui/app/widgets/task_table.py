"""A list of tasks with their commands."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from python_qt_binding.QtCore import QSignalBlocker, Qt, Signal
from python_qt_binding.QtGui import QKeyEvent, QShowEvent
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.forward_clock import now
from skiros2_gui.app.events import RunRecorded, TasksChanged, TaskStarted
from skiros2_gui.app.tasks import STEP, STOP, in_order, is_silent, skills_text
from skiros2_gui.app.widgets.controls import plain_tip, push_button, timer
from skiros2_gui.app.widgets.theme import colour_state
from skiros2_gui.app.window import Window
from skiros2_runs.core.goal_runs import GOALS
from skiros2_runs.core.states import TaskState, style_of
from skiros2_runs.core.task_run import TaskRun

_RUN = Qt.UserRole
_HEADS = ("Skill", "State", "Time", "Task", "Robot", "Message")
_SKILL, _STATE, _TASK, _ROBOT, _MESSAGE = 0, 1, 3, 4, 5

#: The delay that combines updates, and the period of run time updates (ms).
_UPDATE_DELAY, _TIME_PERIOD = 100, 1000


class TaskTable(QWidget):
    """Lists tasks; the buttons act on the selected one.

    :param name: the object name of the list.
    :param runs: returns the tasks.
    :param shown: returns the task to select; the list is narrow then, without numbers and messages. None: the list
        keeps its selection, and selects a new task unless a running one is selected.
    """

    #: Another task was selected, by the user or because it is new.
    picked = Signal(object)

    def __init__(
        self,
        window: Window,
        name: str,
        runs: Callable[[], Iterable[TaskRun]],
        shown: Callable[[], TaskRun | None] | None = None,
    ) -> None:
        super().__init__()
        self._window = window
        self._runs = runs
        self._shown = shown
        self._items: dict[TaskRun, QTreeWidgetItem] = {}
        self.list = QTreeWidget()
        self.list.setObjectName(name)
        self.list.setAccessibleName("Tasks")
        self.list.setHeaderLabels(_HEADS)
        self.list.setRootIsDecorated(False)
        self.list.setUniformRowHeights(True)
        self.list.setAllColumnsShowFocus(True)
        self.list.setSelectionMode(QAbstractItemView.SingleSelection)
        self.list.setTextElideMode(Qt.ElideRight)
        self.list.setToolTip("Double-click: shows the task in the tab Running")
        header = self.list.header()
        header.setStretchLastSection(False)
        header.setResizeContentsPrecision(0)  # visible rows only
        header.setSectionResizeMode(QHeaderView.ResizeToContents)
        header.setSectionResizeMode(_SKILL if shown is not None else _MESSAGE, QHeaderView.Stretch)
        for column in (_TASK, _MESSAGE):
            self.list.setColumnHidden(column, shown is not None)
        self.list.currentItemChanged.connect(lambda *_: self._on_selected())
        self.list.itemDoubleClicked.connect(lambda item, _: self._open(item.data(0, _RUN)))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 4, 0, 0)
        column.addLayout(self._buttons())
        column.addWidget(self.list, 1)
        self._update_timer = timer(self, _UPDATE_DELAY, self.show_tasks)
        self._clock = timer(self, _TIME_PERIOD, self._show_times, repeats=True)
        self._clock.start()
        if shown is None:  # else the tab calls `show_tasks`
            window.subscribe(TasksChanged, lambda _: self._update_soon())
            window.subscribe(RunRecorded, lambda _: self._update_soon())
        self.show_tasks()

    def _buttons(self) -> QHBoxLayout:
        self.pause = push_button("", "pauseButton", self._pause_or_resume)
        self.step = push_button("Step", "stepButton", lambda: self._command(STEP), "Ticks the paused task once")
        self.stop = push_button("■ Stop", "stopButton", self.stop_selected, "Ends the task  (space or Del in the list)")
        clear_ended = self._window.tasks.clear_ended
        self.clear = push_button("Clear", "clearButton", clear_ended, "Removes the tasks that have ended")
        row = QHBoxLayout()
        row.setSpacing(4)
        row.addStretch(1)
        for button in (self.pause, self.step, self.stop, self.clear):
            button.setMinimumWidth(button.fontMetrics().height() + 8)
            row.addWidget(button)
        return row

    # -- commands ---------------------------------------------------------------------------------------------

    @property
    def selected(self) -> TaskRun | None:
        """The selected task."""
        item = self.list.currentItem()
        return item.data(0, _RUN) if item is not None else None

    def stop_selected(self) -> None:
        """Stops the selected task."""
        self._command(STOP)

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.show_tasks()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key_Delete:
            self.stop_selected()
        else:
            super().keyPressEvent(event)

    def _open(self, run: TaskRun) -> None:
        """Shows a task in the tab "Running"."""
        if self._is_live(run):
            self._window.publish(TaskStarted(run.robot, run.task_id, to_front=True))

    def _command(self, action: str) -> None:
        run = self.selected
        if run is not None and self._is_live(run) and not run.is_finished:
            self._window.tasks.command(action, run.robot, run.task_id)

    def _pause_or_resume(self) -> None:
        if self.selected is not None:
            self._window.tasks.toggle(self.selected)

    def _on_selected(self) -> None:
        self._show_buttons()
        if self.selected is not None:
            self.picked.emit(self.selected)

    # -- display ------------------------------------------------------------------------------------------------

    def _update_soon(self) -> None:
        if self.isVisible() and not self._update_timer.isActive():
            self._update_timer.start()

    def show_tasks(self) -> None:
        """Updates the list and keeps the selection."""
        runs = in_order(self._runs())
        before = self.selected
        with QSignalBlocker(self.list):
            if runs != list(self._items):
                self._rebuild(runs)
            if self._shown is not None:
                shown = self._shown()
                self.list.setCurrentItem(self._items.get(shown) if shown is not None else None)
            for run in runs:
                self._fill(self._items[run], run)
        robots = {run.robot for run in runs} - {GOALS}
        self.list.setColumnHidden(_ROBOT, self._shown is not None and len(robots) < 2)
        self.clear.setEnabled(any(run.is_finished and self._is_live(run) for run in runs))
        self._show_buttons()
        if self._shown is None and self.selected is not before:
            self.picked.emit(self.selected)

    def _rebuild(self, runs: list[TaskRun]) -> None:
        chosen = self.selected
        new = [run for run in runs if run not in self._items]
        self.list.clear()
        self._items = {}
        for run in runs:
            item = QTreeWidgetItem()
            item.setData(0, _RUN, run)
            self._items[run] = item
            self.list.addTopLevelItem(item)
        if new and (chosen is None or chosen.is_finished):
            chosen = new[0]
        if runs:
            self.list.setCurrentItem(self._items[chosen if chosen in self._items else runs[0]])

    def _fill(self, item: QTreeWidgetItem, run: TaskRun) -> None:
        style, silent = style_of(run.state), self._is_live(run) and is_silent(run, now())
        state = "… silent" if silent else f"{style.symbol} {style.word}"
        skills = skills_text(run)
        message = self._window.tasks.message(run)
        robot = "" if run.robot == GOALS else run.robot.lstrip("/")
        texts = (skills, state, self._duration(run), str(run.task_id), robot, message)
        for column, text in enumerate(texts):
            if item.text(column) != text:
                item.setText(column, text)
                task = f"task {run.task_id} of {run.robot}" if robot else f"goal {run.task_id}"
                more = f"\n{task}" if column == _SKILL else ""
                item.setToolTip(column, plain_tip(text + more))
        colour_state(item, _STATE, "silent" if silent else run.state, self.list)

    def _duration(self, run: TaskRun) -> str:
        """Formats the run time."""
        ends_now = self._is_live(run) and not run.is_finished
        seconds = max(0.0, (max(now(), run.latest.time) if ends_now else run.latest.time) - run.start)
        if seconds < 60.0:
            return f"{seconds:.0f} s" if ends_now else f"{seconds:.1f} s"
        minutes, rest = divmod(int(seconds), 60)
        hours, minutes = divmod(minutes, 60)
        return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"

    def _is_live(self, run: TaskRun) -> bool:
        """Returns whether it is a task of a robot, not of a bag."""
        return run in list(self._window.tasks.runs)

    def _show_times(self) -> None:
        for run, item in self._items.items():
            if not run.is_finished:
                self._fill(item, run)

    def _show_buttons(self) -> None:
        run = self.selected
        is_active = run is not None and not run.is_finished and self._is_live(run)
        is_paused = is_active and run is not None and run.state is TaskState.PAUSED
        symbol = "" if self._shown is not None else "▶ " if is_paused else "❚❚ "  # a narrow list has no room for it
        self.pause.setText(symbol + ("Resume" if is_paused else "Pause"))
        self.pause.setToolTip("Resumes the task" if is_paused else "Pauses the task: it is not ticked")
        self.pause.setEnabled(is_active and run is not None and run.state is not TaskState.ENDING)
        self.step.setEnabled(is_paused)
        self.stop.setEnabled(is_active)

    def close_timers(self) -> None:
        """Stops the timers."""
        self._update_timer.stop()
        self._clock.stop()
