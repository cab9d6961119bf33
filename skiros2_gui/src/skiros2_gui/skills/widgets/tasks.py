"""The list of tasks with its commands, and why a task failed."""

from __future__ import annotations

import time

from python_qt_binding.QtCore import QEvent, QSignalBlocker, Qt, QTimer
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QPlainTextEdit,
    QPushButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.events import FailureExplained, RunRecorded, TasksChanged, TaskStarted
from skiros2_gui.app.tasks import STEP, STOP, is_silent, message_text
from skiros2_gui.app.widgets.theme import colour_state
from skiros2_gui.app.window import Window
from skiros2_runs.core.states import TaskState, style_of
from skiros2_runs.core.task_run import TaskRun

_RUN = Qt.UserRole
_HEADS = ("Robot", "Task", "Skill", "State", "Time", "Message")

#: The delay that combines updates, and the period of run time updates (ms).
_UPDATE_DELAY, _TIME_PERIOD = 100, 1000


class TaskTable(QWidget):
    """Shows the tasks of all robots; the buttons act on the selected one."""

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._window = window
        self._tasks = window.tasks
        self._items: dict[TaskRun, QTreeWidgetItem] = {}
        self.list = QTreeWidget()
        self.list.setObjectName("taskList")
        self.list.setAccessibleName("Tasks")
        self.list.setHeaderLabels(_HEADS)
        self.list.setRootIsDecorated(False)
        self.list.setUniformRowHeights(True)
        self.list.setAllColumnsShowFocus(True)
        self.list.setSelectionMode(QAbstractItemView.SingleSelection)
        self.list.setTextElideMode(Qt.ElideRight)
        self.list.header().setStretchLastSection(True)
        self.list.header().setSectionResizeMode(QHeaderView.Interactive)
        self.list.currentItemChanged.connect(lambda *_: self._selected())
        self.list.itemDoubleClicked.connect(lambda item, _: self._open(item.data(0, _RUN)))
        self.list.setToolTip("Double-click: shows the task in the tab Running")
        self.why = QPlainTextEdit()
        self.why.setObjectName("taskWhy")
        self.why.setReadOnly(True)
        self.why.hide()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 4, 0, 0)
        column.addLayout(self._buttons())
        column.addWidget(self.list, 1)
        column.addWidget(self.why)
        self._update_timer = QTimer(self)
        self._update_timer.setSingleShot(True)
        self._update_timer.setInterval(_UPDATE_DELAY)
        self._update_timer.timeout.connect(self.show_tasks)
        self._clock = QTimer(self)
        self._clock.setInterval(_TIME_PERIOD)
        self._clock.timeout.connect(self._show_times)
        self._clock.start()
        window.subscribe(TasksChanged, lambda _: self._update_soon())
        window.subscribe(RunRecorded, lambda _: self._update_soon())
        window.subscribe(FailureExplained, lambda _: self._show_why())
        self.show_tasks()
        self._fit()

    def _buttons(self) -> QHBoxLayout:
        def make(text: str, name: str, tip: str) -> QPushButton:
            button = QPushButton(text)
            button.setObjectName(name)
            button.setToolTip(tip)
            button.setAutoDefault(False)
            row.addWidget(button)
            return button

        row = QHBoxLayout()
        row.addStretch(1)
        self.pause = make("❚❚ Pause", "pauseButton", "Pauses the selected task: it is not ticked")
        self.step = make("Step", "stepButton", "Ticks the selected, paused task once")
        self.stop = make("■ Stop", "stopButton", "Ends the selected task  (space or Del in the list)")
        self.clear = make("Clear ended", "clearButton", "Removes the tasks that have ended from the list")
        self.pause.clicked.connect(self._pause_or_resume)
        self.step.clicked.connect(lambda: self._command(STEP))
        self.stop.clicked.connect(lambda: self._command(STOP))
        self.clear.clicked.connect(self._tasks.clear_ended)
        return row

    # -- commands ---------------------------------------------------------------------------------------------

    @property
    def selected(self) -> TaskRun | None:
        """The selected task."""
        item = self.list.currentItem()
        return item.data(0, _RUN) if item is not None else None

    def toggle(self) -> None:
        """Stops the selected task."""
        self._command(STOP)

    def keyPressEvent(self, event: object) -> None:
        if event.key() == Qt.Key_Delete:  # type: ignore[attr-defined]
            self.toggle()
        else:
            super().keyPressEvent(event)

    def _open(self, run: TaskRun) -> None:
        """Shows a task in the tab "Running"."""
        self._window.publish(TaskStarted(run.robot, run.task_id, to_front=True))

    def _command(self, action: str) -> None:
        run = self.selected
        if run is not None and not run.is_finished:
            self._tasks.command(action, run.robot, run.task_id)

    def _pause_or_resume(self) -> None:
        if self.selected is not None:
            self._tasks.toggle(self.selected)

    def _selected(self) -> None:
        self._show_buttons()
        if self.selected is None or self.selected is not self._tasks.why_of:
            self._tasks.ask_why(self.selected)

    # -- display ------------------------------------------------------------------------------------------------

    def _update_soon(self) -> None:
        if not self._update_timer.isActive():
            self._update_timer.start()

    def show_tasks(self) -> None:
        """Updates the list and keeps the selection; a new task is selected unless a running one is."""
        runs = self._tasks.rows
        chosen = self.selected
        with QSignalBlocker(self.list):
            if runs != list(self._items):
                self._rebuild(runs, chosen)
            for run in runs:
                self._fill(self._items[run], run)
        self.clear.setEnabled(any(run.is_finished for run in runs))
        now = self.selected
        if now is not None and now.state is TaskState.FAILED and self._tasks.why_of is not now:
            self._tasks.ask_why(now)
        self._show_buttons()

    def _rebuild(self, runs: list[TaskRun], chosen: TaskRun | None) -> None:
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
        item = self._items.get(chosen) if chosen is not None else None
        if item is None and runs:
            item = self._items[runs[0]]
        if item is not None:
            self.list.setCurrentItem(item)

    def _fill(self, item: QTreeWidgetItem, run: TaskRun) -> None:
        style = style_of(run.state)
        state = "… silent" if is_silent(run, time.time()) else f"{style.symbol} {style.word}"
        skills = run.latest.shape.skills_text(most=3)
        texts = (run.robot.lstrip("/"), str(run.task_id), skills, state, _duration(run), message_text(run))
        for column, text in enumerate(texts):
            if item.text(column) != text:
                item.setText(column, text)
                item.setToolTip(column, text)
        colour_state(item, 3, "silent" if is_silent(run, time.time()) else run.state, self.list)

    def _show_times(self) -> None:
        for run, item in self._items.items():
            if not run.is_finished:
                self._fill(item, run)

    def _show_buttons(self) -> None:
        run = self.selected
        is_active = run is not None and not run.is_finished
        is_paused = run is not None and run.state is TaskState.PAUSED
        self.pause.setText("▶ Resume" if is_paused else "❚❚ Pause")
        self.pause.setToolTip(
            "Resumes the selected task" if is_paused else "Pauses the selected task: it is not ticked"
        )
        self.pause.setEnabled(is_active)
        self.step.setEnabled(is_paused)
        self.stop.setEnabled(is_active)

    def _show_why(self) -> None:
        self.why.setPlainText("\n".join(self._tasks.why))
        self.why.setVisible(bool(self._tasks.why))

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._fit()

    def _fit(self) -> None:
        """Follows the text size."""
        self.why.setMaximumHeight(self.fontMetrics().lineSpacing() * 8)
        for column, text in enumerate(("test_robot__", "Task___", "pick_and_place____", "succeeded____", "00:00:00_")):
            self.list.setColumnWidth(column, self.fontMetrics().horizontalAdvance(text) + 12)

    def close_timers(self) -> None:
        """Stops the timers."""
        self._update_timer.stop()
        self._clock.stop()


def _duration(run: TaskRun) -> str:
    """Formats the run time."""
    end = run.latest.time if run.is_finished else max(time.time(), run.latest.time)
    seconds = max(0.0, end - run.start)
    if seconds < 60.0:
        return f"{seconds:.1f} s" if run.is_finished else f"{seconds:.0f} s"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
