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

from skiros2_gui.app.widgets.theme import colour_state
from skiros2_gui.skills.task_presenter import TaskListPresenter
from skiros2_gui.skills.task_rows import Key, TaskRow

_KEY = Qt.UserRole
_HEADS = ("Robot", "Task", "Skill", "State", "Time", "Message")
_SIGNS = {"running": "▶", "paused": "❚❚", "succeeded": "✓", "failed": "✕", "lost": "?", "silent": "…"}

#: The delay that combines updates, and the period of run time updates (ms).
_UPDATE_DELAY, _TIME_PERIOD = 100, 1000


class TaskList(QWidget):
    """Shows the tasks of all robots; the buttons act on the selected one."""

    def __init__(self, presenter: TaskListPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._items: dict[Key, QTreeWidgetItem] = {}
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
        self.list.itemDoubleClicked.connect(lambda item, _: presenter.show(item.data(0, _KEY)))
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
        presenter.on_tasks = lambda: self._update_timer.isActive() or self._update_timer.start()  # type: ignore[func-returns-value]
        presenter.on_why = self._show_why
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
        self.stop_all = make("Stop all", "stopAllButton", "Ends all tasks of all robots")
        self.clear = make("Clear ended", "clearButton", "Removes the tasks that have ended from the list")
        self.pause.clicked.connect(self._pause_or_resume)
        self.step.clicked.connect(lambda: self._with_selected(self._presenter.step))
        self.stop.clicked.connect(lambda: self._with_selected(self._presenter.stop))
        self.stop_all.clicked.connect(self._presenter.stop_all)
        self.clear.clicked.connect(self._presenter.clear_ended)
        return row

    # -- commands ---------------------------------------------------------------------------------------------

    @property
    def selected(self) -> TaskRow | None:
        """The selected task."""
        item = self.list.currentItem()
        return self._presenter.get(item.data(0, _KEY)) if item is not None else None

    def toggle(self) -> None:
        """Stops the selected task."""
        row = self.selected
        if row is not None and not row.is_finished:
            self._presenter.stop(row.key)

    def keyPressEvent(self, event: object) -> None:
        if event.key() == Qt.Key_Delete:  # type: ignore[attr-defined]
            self.toggle()
        else:
            super().keyPressEvent(event)

    def _with_selected(self, action: object) -> None:
        row = self.selected
        if row is not None:
            action(row.key)  # type: ignore[operator]

    def _pause_or_resume(self) -> None:
        row = self.selected
        if row is not None:
            (self._presenter.resume if row.state == "paused" else self._presenter.pause)(row.key)

    def _selected(self) -> None:
        row = self.selected
        self._show_buttons()
        if row is None or row.key != self._presenter.why_of:
            self._presenter.ask_why(row.key if row is not None else None)

    # -- display ------------------------------------------------------------------------------------------------

    def show_tasks(self) -> None:
        """Updates the list and keeps the selection; a new task is selected unless a running one is."""
        rows = self._presenter.rows
        chosen = self.selected
        with QSignalBlocker(self.list):
            keys = [row.key for row in rows]
            if keys != list(self._items):
                self._rebuild(rows, chosen)
            for row in rows:
                self._fill(self._items[row.key], row)
        self.clear.setEnabled(any(row.is_finished for row in rows))
        self.stop_all.setEnabled(any(not row.is_finished for row in rows))
        now = self.selected
        if now is not None and now.state == "failed" and self._presenter.why_of != now.key:
            self._presenter.ask_why(now.key)
        self._show_buttons()

    def _rebuild(self, rows: list[TaskRow], chosen: TaskRow | None) -> None:
        new = [row for row in rows if row.key not in self._items]
        self.list.clear()
        self._items = {}
        for row in rows:
            item = QTreeWidgetItem()
            item.setData(0, _KEY, row.key)
            self._items[row.key] = item
            self.list.addTopLevelItem(item)
        if new and (chosen is None or chosen.is_finished):
            chosen = new[0]
        item = self._items.get(chosen.key) if chosen is not None else None
        if item is None and rows:
            item = self._items[rows[0].key]
        if item is not None:
            self.list.setCurrentItem(item)

    def _fill(self, item: QTreeWidgetItem, row: TaskRow) -> None:
        state = row.state_at(time.time())
        shown = f"{_SIGNS.get(state, '')} {state}"
        texts = (row.manager.lstrip("/"), str(row.task), row.skill, shown, _duration(row), row.message)
        for column, text in enumerate(texts):
            if item.text(column) != text:
                item.setText(column, text)
                item.setToolTip(column, text)
        colour_state(item, 3, state, self.list)

    def _show_times(self) -> None:
        for row in self._presenter.rows:
            item = self._items.get(row.key)
            if item is not None and not row.is_finished:
                self._fill(item, row)

    def _show_buttons(self) -> None:
        row = self.selected
        is_active = row is not None and not row.is_finished
        is_paused = is_active and row is not None and row.state == "paused"
        self.pause.setText("▶ Resume" if is_paused else "❚❚ Pause")
        self.pause.setToolTip(
            "Resumes the selected task" if is_paused else "Pauses the selected task: it is not ticked"
        )
        self.pause.setEnabled(is_active)
        self.step.setEnabled(is_paused)
        self.stop.setEnabled(is_active)

    def _show_why(self) -> None:
        self.why.setPlainText("\n".join(self._presenter.why))
        self.why.setVisible(bool(self._presenter.why))

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


def _duration(row: TaskRow) -> str:
    """Formats the run time."""
    seconds = max(0.0, (row.updated if row.is_finished else max(time.time(), row.updated)) - row.start)
    if seconds < 60.0:
        return f"{seconds:.1f} s" if row.is_finished else f"{seconds:.0f} s"
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
