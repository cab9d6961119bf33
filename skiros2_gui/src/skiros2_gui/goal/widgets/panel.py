"""The goal as a sentence with its buttons, and the view of plan and execution."""

from __future__ import annotations

from collections.abc import Sequence

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import (
    QHBoxLayout,
    QMenu,
    QPlainTextEdit,
    QSizePolicy,
    QSplitter,
    QTabWidget,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.app.widgets.theme import STATE_COLOURS, colour_label
from skiros2_gui.goal.plan import GoalExecution, GoalPlan, StepRow
from skiros2_gui.goal.presenter import GoalPresenter

_HEADS = ("Step", "State", "Start", "End", "Robot", "Skill", "After", "With")
_STATE = 1
_SIGNS = {"waiting": "·", "running": "▶", "succeeded": "✓", "failed": "✕", "stopped": "■", "dropped": "–"}


class GoalBar(QWidget):
    """The goal as a sentence, and its buttons."""

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self.sentence = text_label("goalSentence")
        self.sentence.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.earlier = QToolButton()
        self.earlier.setObjectName("goalEarlier")
        self.earlier.setText("Earlier")
        self.earlier.setToolTip("Goals planned or achieved before")
        self.earlier.setPopupMode(QToolButton.InstantPopup)
        self._menu = QMenu(self)
        self._menu.aboutToShow.connect(self._fill_menu)
        self.earlier.setMenu(self._menu)
        self.plan = push_button("Plan", "planButton", goals.make_plan)
        self.achieve = push_button("▶ Achieve", "achieveButton", goals.achieve)
        self.cancel = push_button("Cancel", "cancelGoalButton", goals.cancel, "Cancels planning or execution")
        heading = PlainLabel("Goal")
        font = heading.font()
        font.setBold(True)
        heading.setFont(font)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(heading)
        row.addWidget(self.sentence, 1)
        for button in (self.earlier, self.plan, self.achieve, self.cancel):
            row.addWidget(button)

    def show_goal(self) -> None:
        """Shows the presenter's state."""
        goals = self._goals
        self.sentence.setText(goals.sentence or "Choose what to reach in the tab Goal.")
        self.sentence.setToolTip(plain_tip(goals.text))
        colour_label(self.sentence, "" if goals.sentence else "idle")
        self.plan.setEnabled(goals.can_plan)
        self.achieve.setEnabled(goals.can_plan)
        missing = "" if goals.has_task_manager else "The task manager is not running"
        self.plan.setToolTip(plain_tip(missing or "Plans the goal and shows what would change; nothing moves  (Enter)"))
        self.achieve.setToolTip(plain_tip(missing or "Plans the goal, and has the robots execute the plan"))
        self.cancel.setEnabled(goals.is_busy)
        self.earlier.setEnabled(bool(goals.history))

    def _fill_menu(self) -> None:
        self._menu.clear()
        for goal in self._goals.history:
            shown = self._goals.sentence_of(goal)
            text = shown if len(shown) <= 100 else f"{shown[:99]}…"
            action = self._menu.addAction(text.replace("&", "&&"), lambda goal=goal: self._goals.write(goal))
            action.setToolTip(plain_tip(goal))


class GoalView(QWidget):
    """The steps of the plan, their effects, and why."""

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self._shown: GoalPlan | GoalExecution | None = None
        self.head = text_label("planHead")
        self.head.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.steps = RowsView(RowsModel(_HEADS), len(_HEADS) - 1, wraps=True)
        self.steps.setObjectName("planView")
        self.steps.setAccessibleName("Steps of the plan")
        self.changes = _text("planChanges", "What each step would change, simulated on a copy of the scene")
        self.why = _text("planWhy", "What each step is for; without a plan, why there is none")
        self.texts = QTabWidget()
        self.texts.setDocumentMode(True)
        self.texts.addTab(self.changes, "What changes")
        self.texts.addTab(self.why, "Why")
        self.across = QSplitter(Qt.Horizontal)
        self.across.setChildrenCollapsible(False)
        self.across.addWidget(self.steps)
        self.across.addWidget(self.texts)
        self.across.setStretchFactor(0, 3)
        self.across.setStretchFactor(1, 2)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 4, 0, 0)
        column.addWidget(self.head)
        column.addWidget(self.across, 1)
        self.show_goal()

    def show_goal(self) -> None:
        """Shows the presenter's plan or execution."""
        goals = self._goals
        result = goals.execution or goals.plan
        self.head.setText(goals.names.in_text(_head(goals)))
        self.head.setToolTip(plain_tip(goals.execution.text if goals.execution is not None else ""))
        if result is self._shown and result is not None:
            return
        self._shown = result
        if isinstance(result, GoalPlan):
            self.steps.rows.show_rows([_row(row) for row in result.rows])
            self._show_texts(result.changes, result.why)
        elif isinstance(result, GoalExecution):
            self.steps.rows.show_rows([_row(row, row.state) for row in result.rows])
            messages = [f"{row.number}. {row.skill}: {row.message}" for row in result.rows if row.message]
            self._show_texts((), (*result.why, *messages))
        else:
            self.steps.rows.show_rows([])
            self._show_texts((), ())
        self.steps.setColumnHidden(_STATE, not isinstance(result, GoalExecution))

    def _show_texts(self, changes: Sequence[str], why: Sequence[str]) -> None:
        for box, lines in ((self.changes, changes), (self.why, why)):
            text = self._goals.names.in_text("\n".join(lines))
            if box.toPlainText() != text:
                box.setPlainText(text)
        self.texts.setTabEnabled(0, bool(changes))
        self.texts.setTabEnabled(1, bool(why))
        self.texts.setCurrentIndex(0 if changes else 1)
        self.texts.setVisible(bool(changes or why))


def _head(goals: GoalPresenter) -> str:
    execution, plan = goals.execution, goals.plan
    if execution is not None:
        sign = ("✓" if execution.reached else "✕") if execution.is_finished else "▶"
        if not execution.is_finished:
            cancelling = "Cancelling: " if goals.is_cancelling else ""
            return f"{sign} {cancelling}{execution.progress_text}"
        return f"{sign} {execution.text}"
    if goals.is_busy:
        return goals.activity
    if plan is None:
        if not goals.has_task_manager:
            return "Goals are planned by the task manager, which is not running."
        return "Choose a goal: Plan shows the steps, Achieve lets the robots execute them."
    if plan.state == "planned":
        return f"✓ {plan.head}" if plan.works else f"✕ {plan.head}; it fails in a simulation on a copy of the scene"
    return f"{'✓' if plan.state == 'nothing_to_do' else '✕'} {plan.head}"


def _row(row: StepRow, state: str = "") -> Row:
    cells = (
        str(row.number),
        f"{_SIGNS.get(state, '')} {state}".strip(),
        f"{row.start:.1f} s",
        f"{row.end:.1f} s",
        row.robot.lstrip("/"),
        row.skill,
        ", ".join(map(str, row.after)),
        row.parameters,
    )
    return Row(cells, colour=STATE_COLOURS.get(state, "idle") if state else "", coloured=_STATE)


def _text(name: str, tip: str) -> QPlainTextEdit:
    box = QPlainTextEdit()
    box.setObjectName(name)
    box.setReadOnly(True)
    box.setToolTip(plain_tip(tip))
    return box
