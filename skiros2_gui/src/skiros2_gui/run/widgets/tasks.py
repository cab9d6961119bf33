"""The list of tasks and the commands for the shown one."""

from __future__ import annotations

import time
from collections.abc import Callable

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QListWidget,
    QListWidgetItem,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.tasks import STEP, STOP, message_text
from skiros2_gui.app.widgets import media_icons
from skiros2_gui.app.widgets.media_icons import media_icon
from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.run.presenter import RunPresenter
from skiros2_runs.core.states import style_of
from skiros2_runs.core.task_run import TaskRun


class TaskPanel(QWidget):
    """The list of tasks, command buttons, and the button for bags."""

    def __init__(self, presenter: RunPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self.folder = ""
        self._source = QLabel()
        self._source.setWordWrap(True)
        self._source.setTextFormat(Qt.PlainText)
        self._list = QListWidget()
        self._list.setObjectName("taskChoice")
        self._list.setAccessibleName("tasks")
        self._list.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        self._list.setToolTip("running tasks, and tasks that have ended since the window was opened")
        self._list.currentItemChanged.connect(self._on_chosen)
        self.pause = self._tool("pauseTask", presenter.toggle)
        self.step = self._tool("stepTask", lambda: presenter.command(STEP))
        self.stop = self._tool("stopTask", lambda: presenter.command(STOP))
        self.step.setText("Step")
        self.step.setToolTip("tick the task once and pause it")
        self.stop.setText("Stop")
        self.stop.setToolTip("preempt the task")
        self._open = QToolButton()
        self._open.setObjectName("openBag")
        self._open.setToolTip("show the tasks of a recorded run")
        self._open.clicked.connect(self._on_bag)
        self._clear = QToolButton()
        self._clear.setText("Clear ended")
        self._clear.setObjectName("clearEnded")
        self._clear.setToolTip("remove the tasks that have ended from the list")
        self._clear.clicked.connect(presenter.clear_ended)
        buttons, below = _row(self.pause, self.stop, self.step), _row(self._open, self._clear)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self._source)
        column.addLayout(buttons)
        column.addWidget(self._list, 1)
        column.addLayout(below)
        self._draw_icons()
        self.show_tasks()

    def show_tasks(self) -> None:
        """Shows the tasks, newest first."""
        presenter = self._presenter
        bag = presenter.bag
        self._source.setText(f"Tasks of {bag.path.rpartition('/')[2]}" if bag is not None else "Tasks of all robots")
        self._source.setToolTip(bag.path if bag is not None else "")
        self._open.setText("Close bag" if bag is not None else "Open bag…")
        runs = list(presenter.runs)[::-1]
        self._list.blockSignals(True)
        while self._list.count() > len(runs):
            self._list.takeItem(self._list.count() - 1)
        while self._list.count() < len(runs):
            self._list.addItem(QListWidgetItem())
        are_several = len({run.robot for run in runs}) > 1
        for number, run in enumerate(runs):
            self._fill(self._list.item(number), run, are_several)
            if run is presenter.run:
                self._list.setCurrentRow(number)
        if presenter.run is None:
            self._list.setCurrentRow(-1)
        self._list.blockSignals(False)
        self._clear.setEnabled(bag is None and any(run.is_finished for run in runs))
        for button in (self.pause, self.step, self.stop):
            button.setEnabled(presenter.is_live)
        self.pause.setText("Resume" if presenter.is_paused else "Pause")
        self._show_icon()
        self.pause.setToolTip(
            "resume the task (space)" if presenter.is_paused else "pause the task; it keeps its state (space)"
        )

    def _fill(self, item: QListWidgetItem, run: TaskRun, names_robot: bool) -> None:
        style = style_of(run.state)
        of = f"\n     {run.robot.lstrip('/')}" if names_robot else ""
        first = run.latest.shape.skills_text(most=1) or run.latest.shape.name(0)
        item.setText(f"{style.symbol} {first}\n     task {run.task_id}, {style.word}{of}")
        item.setData(Qt.UserRole, run)
        began = time.strftime("%H:%M:%S", time.localtime(run.start))
        said = message_text(run)
        where = f"task {run.task_id} of {run.robot}, first seen at {began}"
        item.setToolTip(f"{where}\n{said[:300]}" if said else where)
        item.setForeground(role_colour(style.colour_role, self))

    def _on_chosen(self, item: QListWidgetItem | None, _: QListWidgetItem | None) -> None:
        if item is not None:
            self._presenter.pick(item.data(Qt.UserRole))

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.PaletteChange:
            self._draw_icons()
            self.show_tasks()

    def _draw_icons(self) -> None:
        self._icons = {kind: media_icon(kind, self) for kind in (media_icons.PLAY, media_icons.PAUSE)}
        self.step.setIcon(media_icon(media_icons.STEP, self))
        self.stop.setIcon(media_icon(media_icons.STOP, self))
        self._show_icon()

    def _show_icon(self) -> None:
        self.pause.setIcon(self._icons[media_icons.PLAY if self._presenter.is_paused else media_icons.PAUSE])

    def _on_bag(self) -> None:
        if self._presenter.bag is not None:
            self._presenter.close_bag()
            return
        path, _ = QFileDialog.getOpenFileName(self, "Open a recorded run", self.folder, "Bags (*.bag);;All files (*)")
        if path:
            self.folder = path.rpartition("/")[0]
            self._presenter.open_bag(path)

    def _tool(self, name: str, call: Callable[[], None]) -> QToolButton:
        button = QToolButton()
        button.setObjectName(name)
        button.setToolButtonStyle(Qt.ToolButtonTextBesideIcon)
        button.clicked.connect(lambda: call())
        return button


def _row(*buttons: QToolButton) -> QHBoxLayout:
    """Returns a row of buttons that shrink if necessary."""
    row = QHBoxLayout()
    row.setSpacing(4)
    for button in buttons:
        button.setMinimumWidth(button.fontMetrics().height() + 8)
        button.setSizePolicy(QSizePolicy.Preferred, QSizePolicy.Fixed)
        row.addWidget(button)
    row.addStretch(1)
    return row
