"""The tab "Skills"."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from python_qt_binding.QtCore import QByteArray, QEvent, Qt
from python_qt_binding.QtWidgets import QPlainTextEdit, QSplitter, QTabWidget, QVBoxLayout, QWidget

from skiros2_gui.app.events import FailureExplained, TaskStarted
from skiros2_gui.app.system import MANAGER
from skiros2_gui.app.widgets.controls import timer
from skiros2_gui.app.widgets.task_table import TaskTable
from skiros2_gui.app.window import Window
from skiros2_gui.goal.presenter import GoalPresenter
from skiros2_gui.goal.widgets.lines import GoalLines
from skiros2_gui.goal.widgets.panel import GoalBar, GoalView
from skiros2_gui.skills.presenter import SkillsPresenter
from skiros2_gui.skills.widgets.form import SkillForm
from skiros2_gui.skills.widgets.tree import SkillTree

#: The period of preview refreshes (ms).
_REFRESH_PERIOD = 500


class SkillsTab(QWidget):
    """See `app.widgets.main_widget.Tab`."""

    title = "Skills"
    needs = (MANAGER,)

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.skills = SkillsPresenter(window)
        self.tree = SkillTree(self.skills)
        self.form = SkillForm(self.skills)
        self.tasks = TaskTable(window, "taskList", lambda: window.tasks.shown)
        self.why = QPlainTextEdit()
        self.why.setObjectName("taskWhy")
        self.why.setReadOnly(True)
        self.why.hide()
        self._fit_text()
        self.across = QSplitter(Qt.Horizontal)
        self.across.addWidget(self.tree)
        self.across.addWidget(self.form)
        self.across.setStretchFactor(0, 1)
        self.across.setStretchFactor(1, 2)
        self.across.setSizes([300, 600])
        self.goals = GoalPresenter(window)
        self.goal_bar = GoalBar(self.goals)
        self.goal_lines = GoalLines(self.goals)
        self.goal_view = GoalView(self.goals)
        self.goals.on_goal = self._show_goal
        self.below = QTabWidget()
        self.below.setDocumentMode(True)
        self.tasks.layout().addWidget(self.why)
        self.below.addTab(self.goal_lines, "Goal")
        self.below.addTab(self.goal_view, "Plan")
        self.below.addTab(self.tasks, "Tasks")
        self.down = QSplitter(Qt.Vertical)
        self.down.addWidget(self.across)
        self.down.addWidget(self._with_goal_bar(self.below))
        self.down.setStretchFactor(0, 3)
        self.down.setStretchFactor(1, 2)
        for splitter in (self.across, self.down):
            splitter.setChildrenCollapsible(False)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self.down)
        self._was_busy = False
        self._task_list = window.tasks
        self.tasks.picked.connect(window.tasks.ask_why)
        window.subscribe(FailureExplained, lambda _: self._show_why())
        window.subscribe(TaskStarted, lambda _: self.below.setCurrentWidget(self.tasks))
        self._show_goal()
        self._refresh_timer = timer(self, _REFRESH_PERIOD, self._refresh, repeats=True)
        self._refresh_timer.start()

    def _with_goal_bar(self, below: QWidget) -> QWidget:
        holder = QWidget()
        column = QVBoxLayout(holder)
        column.setContentsMargins(0, 4, 0, 0)
        column.addWidget(self.goal_bar)
        column.addWidget(below, 1)
        return holder

    def _show_goal(self) -> None:
        was_busy, self._was_busy = self._was_busy, self.goals.is_busy
        self.goal_bar.show_goal()
        self.goal_lines.show_goal()
        self.goal_view.show_goal()
        if self._was_busy and not was_busy:
            self.below.setCurrentWidget(self.goal_view)

    def _show_why(self) -> None:
        self.why.setPlainText("\n".join(self._task_list.why))
        self.why.setVisible(bool(self._task_list.why))

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._fit_text()

    def _fit_text(self) -> None:
        """Follows the text size."""
        self.why.setMaximumHeight(self.fontMetrics().lineSpacing() * 8)

    def settings(self) -> dict[str, Any]:
        return {
            **self.goals.settings(),
            "recent": self.skills.recent.settings(),
            "across": _text(self.across.saveState()),
            "down": _text(self.down.saveState()),
        }

    def restore(self, settings: Mapping[str, Any]) -> None:
        self.goals.restore(settings)
        self.skills.recent.restore(settings.get("recent"))
        for splitter, name in ((self.across, "across"), (self.down, "down")):
            state = settings.get(name)
            if isinstance(state, str):
                splitter.restoreState(QByteArray.fromBase64(state.encode("ascii", "ignore")))

    def find(self) -> None:
        self.tree.search.setFocus(Qt.ShortcutFocusReason)
        self.tree.search.selectAll()

    def toggle(self) -> None:
        if self.tasks.list.hasFocus():
            self.tasks.stop_selected()
        else:
            self.skills.toggle()

    def close_tab(self) -> None:
        self._refresh_timer.stop()
        self.tasks.close_timers()

    def _refresh(self) -> None:
        if self.isVisible():
            self.skills.refresh_if_ready()
            if self.goal_lines.isVisible():
                self.goals.refresh_if_ready()


def _text(state: QByteArray) -> str:
    return bytes(state.toBase64()).decode("ascii")
