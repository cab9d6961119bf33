"""The tabs beside the tree: messages, durations and breakpoints."""

from __future__ import annotations

from collections.abc import Sequence

from python_qt_binding.QtCore import Qt, Signal
from python_qt_binding.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.run.breakpoints import CHOICES
from skiros2_gui.run.node_text import clock_text, duration_text
from skiros2_gui.run.presenter import RunPresenter
from skiros2_runs.core.message_log import LogLine
from skiros2_runs.core.states import style_of
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.core.runtime.history import one_line

_HINTS = {
    "node": "label or type of a node; * matches any text",
    "condition": "label of a condition; * matches any text",
    "world": "id or label of an element, or a relation",
}


class _List(RowsView):
    """A list that emits `picked` on a click or Return."""

    #: The item of a row.
    picked = Signal(object)

    def __init__(self, name: str, accessible_name: str) -> None:
        super().__init__(RowsModel(("",)), 0)
        self.setObjectName(name)
        self.setAccessibleName(accessible_name)
        self.horizontalHeader().hide()
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        for signal in (self.clicked, self.activated):
            signal.connect(lambda index: self.picked.emit(self.rows.rows[index.row()].item))


class MessageList(_List):
    """The messages of a task's nodes; `picked` emits a `LogLine`. Stays at its end unless the user has scrolled."""

    def __init__(self) -> None:
        super().__init__("messages", "progress messages")
        self._shown: tuple[TaskRun | None, int] = (None, 0)

    def show_log(self, run: TaskRun | None) -> None:
        """Shows the messages of a task."""
        shown = (run, run.log.count if run is not None else 0)
        if shown == self._shown:
            return
        self._shown = shown
        bar = self.verticalScrollBar()
        is_at_end = bar.value() >= bar.maximum() - 1
        self.rows.show_rows([_message_row(line) for line in run.log.lines] if run is not None else [])
        if is_at_end:
            self.scrollToBottom()


class TimeList(_List):
    """The durations of the skills; `picked` emits the id of a node."""

    def __init__(self) -> None:
        super().__init__("times", "time of each skill")

    def show_times(self, presenter: RunPresenter) -> None:
        """Shows the durations in the shown tree."""
        frame = presenter.frame
        pairs: Sequence[tuple[int, float]] = presenter.by_time()
        self.rows.show_rows([
            Row(
                (f"{duration_text(seconds)}   {frame.shape.name(index)}",),
                item=frame.shape.id(index),
                colour=style_of(frame.state(index)).colour_role,
            )
            for index, seconds in pairs
            if frame is not None
        ])  # fmt: skip


def _message_row(line: LogLine) -> Row:
    style = style_of(line.state)
    message = one_line(line.message)
    text = f"{clock_text(line.time)}  {style.symbol} {line.name}" + (f": {message}" if message else f" {style.word}")
    return Row((text,), line.message or text, line, style.colour_role)


class BreakpointPanel(QWidget):
    """Lists, adds and removes breakpoints of the shown task's robot."""

    def __init__(self, presenter: RunPresenter) -> None:
        super().__init__()
        self._presenter = presenter
        self._title = QLabel()
        self._title.setWordWrap(True)
        self._list = QListWidget()
        self._list.setObjectName("breakpoints")
        self._list.currentItemChanged.connect(lambda *_: self._enable())
        self._when = QComboBox()
        self._when.setObjectName("breakpointKind")
        for text, kind, when in CHOICES:
            self._when.addItem(f"Pause {text}", (kind, when))
        self._when.currentIndexChanged.connect(lambda _: self._hint())
        self._pattern = QLineEdit()
        self._pattern.setObjectName("breakpointPattern")
        self._pattern.setClearButtonEnabled(True)
        self._pattern.returnPressed.connect(self._add)
        self._pattern.textChanged.connect(lambda _: self._enable())
        self._add_button = QPushButton("Add")
        self._add_button.setObjectName("breakpointAdd")
        self._add_button.clicked.connect(self._add)
        self._remove_button = QPushButton("Remove")
        self._remove_button.setObjectName("breakpointRemove")
        self._remove_button.clicked.connect(self._remove)
        row = QHBoxLayout()
        row.addWidget(self._pattern, 1)
        row.addWidget(self._add_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self._title)
        column.addWidget(self._list, 1)
        column.addWidget(self._remove_button, 0, Qt.AlignRight)
        column.addWidget(self._when)
        column.addLayout(row)
        self._hint()
        self.show_breakpoints()

    def show_breakpoints(self) -> None:
        """Shows the breakpoints of the presenter's robot."""
        robot = self._presenter.robot
        self._title.setText(f"Tasks of {robot.lstrip('/')} pause:" if robot else "No robot is running.")
        known = list(self._presenter.breakpoints.of(robot))
        chosen = self._list.currentRow()
        self._list.clear()
        for one in known:
            item = QListWidgetItem(str(one))
            item.setData(Qt.UserRole, one)
            self._list.addItem(item)
        self._list.setCurrentRow(min(chosen, len(known) - 1))
        self._enable()

    def _hint(self) -> None:
        kind, _ = self._when.currentData()
        self._pattern.setPlaceholderText(_HINTS.get(kind, ""))
        self._pattern.setToolTip(_HINTS.get(kind, ""))

    def _add(self) -> None:
        text, robot = self._pattern.text().strip(), self._presenter.robot
        if text and robot:
            kind, when = self._when.currentData()
            self._presenter.breakpoints.add(robot, kind, text, when)
            self._pattern.clear()

    def _remove(self) -> None:
        item = self._list.currentItem()
        if item is not None:
            self._presenter.breakpoints.remove(item.data(Qt.UserRole))

    def _enable(self) -> None:
        self._add_button.setEnabled(bool(self._presenter.robot and self._pattern.text().strip()))
        self._remove_button.setEnabled(self._list.currentItem() is not None)
