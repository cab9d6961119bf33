"""The lists beside the tree: messages and durations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from python_qt_binding.QtCore import QAbstractListModel, QModelIndex, Qt, Signal
from python_qt_binding.QtWidgets import QAbstractItemView, QListView, QWidget

from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.run.node_text import clock_text, duration_text
from skiros2_gui.run.presenter import RunPresenter
from skiros2_runs.core.message_log import LogLine
from skiros2_runs.core.states import style_of
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.core.runtime.history import one_line


class _Rows(QAbstractListModel):
    """A list model; each row has a text, a state and an item."""

    def __init__(self, widget: QWidget) -> None:
        super().__init__(widget)
        self._widget = widget
        self.rows: list[tuple[str, int, Any]] = []

    def rowCount(self, parent: QModelIndex | None = None) -> int:
        return 0 if parent is not None and parent.isValid() else len(self.rows)

    def data(self, index: QModelIndex, role: int = Qt.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self.rows):
            return None
        text, state, row = self.rows[index.row()]
        if role == Qt.DisplayRole:
            return text
        if role == Qt.ToolTipRole:
            return row.message or text if isinstance(row, LogLine) else text
        if role == Qt.ForegroundRole:
            return role_colour(style_of(state).colour_role, self._widget)
        return None

    def put(self, rows: list[tuple[str, int, Any]]) -> None:
        """Replaces the rows; appended rows are inserted without a reset."""
        known = len(self.rows)
        if len(rows) > known and rows[:known] == self.rows and known:
            self.beginInsertRows(QModelIndex(), known, len(rows) - 1)
            self.rows = rows
            self.endInsertRows()
        elif rows != self.rows:
            self.beginResetModel()
            self.rows = rows
            self.endResetModel()


class _List(QListView):
    """A list that emits `chosen` on a click or Return."""

    #: The item of a row.
    chosen = Signal(object)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.rows = _Rows(self)
        self.setModel(self.rows)
        self.setUniformItemSizes(True)
        self.setEditTriggers(QAbstractItemView.NoEditTriggers)
        self.setTextElideMode(Qt.ElideRight)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        self.clicked.connect(lambda index: self.chosen.emit(self.rows.rows[index.row()][2]))
        self.activated.connect(lambda index: self.chosen.emit(self.rows.rows[index.row()][2]))

    def _put(self, rows: list[tuple[str, int, Any]]) -> None:
        bar = self.verticalScrollBar()
        is_at_end = bar.value() >= bar.maximum() - 1
        at = bar.value()
        self.rows.put(rows)
        if is_at_end and self._stays_at_end():
            self.scrollToBottom()
        else:
            bar.setValue(at)

    def _stays_at_end(self) -> bool:
        return False


class MessageList(_List):
    """The messages of a task's nodes; `chosen` emits a `LogLine`."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("messages")
        self.setAccessibleName("progress messages")
        self._shown: tuple[TaskRun | None, int] = (None, 0)

    def show_log(self, run: TaskRun | None) -> None:
        """Shows the messages of a task."""
        shown = (run, run.log.count if run is not None else 0)
        if shown != self._shown:
            self._shown = shown
            self._put([(_line(line), line.state, line) for line in run.log.lines] if run is not None else [])

    def _stays_at_end(self) -> bool:
        return True


class TimeList(_List):
    """The durations of the skills; `chosen` emits the id of a node."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("times")
        self.setAccessibleName("time of each skill")

    def show_times(self, presenter: RunPresenter) -> None:
        """Shows the durations in the shown tree."""
        frame = presenter.frame
        pairs: Sequence[tuple[int, float]] = presenter.by_time() if frame is not None else []
        self._put([
            (f"{duration_text(seconds)}   {frame.shape.name(index)}", frame.state(index), frame.shape.id(index))
            for index, seconds in pairs
            if frame is not None
        ])  # fmt: skip


def _line(line: LogLine) -> str:
    style = style_of(line.state)
    message = one_line(line.message)
    return f"{clock_text(line.time)}  {style.symbol} {line.name}" + (f": {message}" if message else f" {style.word}")
