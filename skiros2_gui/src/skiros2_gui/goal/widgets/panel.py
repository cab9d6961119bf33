"""The goal line with completion, its buttons, and the view of plan and execution."""

from __future__ import annotations

import re
from collections.abc import Sequence

from python_qt_binding.QtCore import QEvent, QModelIndex, QRect, Qt
from python_qt_binding.QtGui import QKeyEvent, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import (
    QCompleter,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QMenu,
    QPlainTextEdit,
    QSizePolicy,
    QSplitter,
    QTabWidget,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import push_button, text_label
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.app.widgets.theme import STATE_COLOURS, colour_label
from skiros2_gui.goal.completion import KEYWORD, Completion
from skiros2_gui.goal.plan import GoalExecution, GoalPlan, StepRow
from skiros2_gui.goal.presenter import GoalPresenter

_TEXT = Qt.UserRole
_REST_OF_WORD = re.compile(r'^[^\s(),";]+')


class GoalLine(QLineEdit):
    """Ctrl+space completes an empty completion too.

    Tab and Enter insert the selected completion. In a complete goal Enter inserts a completion only if it was selected
    with the arrow keys; otherwise it plans.

    :param below: a label below the line, which the popup does not cover.
    """

    def __init__(self, goals: GoalPresenter, below: QLabel, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self._below = below
        self._start = 0
        self.setObjectName("goalLine")
        self.setAccessibleName("Goal")
        self.setPlaceholderText("Goal, such as (skiros:contain box product)    Ctrl+space: completion")
        self.setToolTip(
            "The state to reach: (relation element element), (not (…)), (forall (?x - class) (…)).\n"
            "Several goals are separated by commas. Words are completed as you type; Enter plans."
        )
        self.setClearButtonEnabled(True)
        self._model = QStandardItemModel(self)
        self._completer = QCompleter(self._model, self)
        self._completer.setWidget(self)
        self.popup = self._completer.popup()
        self._completer.setCompletionMode(QCompleter.UnfilteredPopupCompletion)
        self._completer.setMaxVisibleItems(12)
        self._completer.activated[QModelIndex].connect(self._insert)
        self.textChanged.connect(goals.write)
        self.textEdited.connect(self._edited)
        self.cursorPositionChanged.connect(lambda *_: self.popup.isVisible() and self.show_completions())

    def _edited(self, text: str) -> None:
        self._goals.write(text)  # `textEdited` comes before `textChanged`
        self.show_completions()

    def show_completions(self, even_if_empty: bool = False) -> None:
        """Shows the completions at the cursor."""
        found = self._goals.completions(self.cursorPosition())
        typed = self.text()[found.start : self.cursorPosition()]
        completions = [completion for completion in found.items if completion.text != typed]
        if not completions or not (typed or even_if_empty or self.text()[: self.cursorPosition()].endswith("(")):
            self.popup.hide()
            return
        self._start = found.start
        self._model.clear()
        for completion in completions:
            self._model.appendRow(_item(completion))
        self._completer.complete(self._area())
        self.popup.setCurrentIndex(self._model.index(0, 0))

    def move_popup(self) -> None:
        """Moves the popup, if it is visible, below the label."""
        if self.popup.isVisible():
            self._completer.complete(self._area())

    def _area(self) -> QRect:
        """Returns the rectangle from the cursor to the end of the label; the popup is shown below it."""
        width = self.popup.sizeHintForColumn(0) + self.popup.verticalScrollBar().sizeHint().width() + 12
        area = self.cursorRect()
        area.setWidth(min(max(width, 160), max(self.width(), 160)))
        label = max(self._below.heightForWidth(self._below.width()), self.fontMetrics().lineSpacing())
        area.setBottom(self.height() + label + self.fontMetrics().lineSpacing() // 2)
        return area

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.KeyPress and event.key() == Qt.Key_Tab and self.popup.isVisible():
            self._insert(self.popup.currentIndex())
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key_Space and event.modifiers() == Qt.ControlModifier:
            self.show_completions(even_if_empty=True)
        elif event.key() not in (Qt.Key_Return, Qt.Key_Enter) or not self.popup.isVisible():
            super().keyPressEvent(event)
        elif self._goals.is_complete and self.popup.currentIndex().row() == 0:
            self.popup.hide()
            super().keyPressEvent(event)
            event.accept()
        else:
            event.ignore()  # handled by the completer

    def _insert(self, index: QModelIndex) -> None:
        """Replaces the word at the cursor with a completion."""
        completion = str(index.data(_TEXT))
        self.popup.hide()
        text, cursor = self.text(), self.cursorPosition()
        after = text[cursor:] if self._start == cursor else _REST_OF_WORD.sub("", text[cursor:], count=1)
        gap = "" if completion == "(" or after.startswith((" ", ")")) else " "
        self.setText(f"{text[: self._start]}{completion}{gap}{after}")
        self.setCursorPosition(self._start + len(completion) + len(gap))


def _item(completion: Completion) -> QStandardItem:
    more = "" if completion.kind == KEYWORD else f"   {completion.kind}"
    if more and completion.text != completion.label:
        more += f" {completion.text}"
    item = QStandardItem(f"{completion.label}{more}")
    item.setData(completion.text, _TEXT)
    item.setEditable(False)
    return item


_HEADS = ("Step", "State", "Start", "End", "Robot", "Skill", "After", "With")
_STATE = 1
_SIGNS = {"waiting": "·", "running": "▶", "succeeded": "✓", "failed": "✕", "stopped": "■", "dropped": "–"}


class GoalBar(QWidget):
    """The goal line and its buttons."""

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self.mistake = text_label("goalMistake", is_selectable=False)
        self.mistake.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.line = GoalLine(goals, self.mistake)
        self.line.returnPressed.connect(goals.make_plan)
        self.earlier = QToolButton()
        self.earlier.setObjectName("goalEarlier")
        self.earlier.setText("Earlier ▾")
        self.earlier.setToolTip("Goals planned or achieved before")
        self.earlier.setPopupMode(QToolButton.InstantPopup)
        self._menu = QMenu(self)
        self._menu.aboutToShow.connect(self._fill_menu)
        self.earlier.setMenu(self._menu)
        self.plan = push_button("Plan", "planButton", goals.make_plan)
        self.achieve = push_button("▶ Achieve", "achieveButton", goals.achieve)
        self.cancel = push_button("■ Cancel", "cancelGoalButton", goals.cancel, "Cancels planning or execution")
        heading = QLabel("Goal")
        font = heading.font()
        font.setBold(True)
        heading.setFont(font)
        row = QHBoxLayout()
        row.addWidget(heading)
        row.addWidget(self.line, 1)
        for button in (self.earlier, self.plan, self.achieve, self.cancel):
            row.addWidget(button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(row)
        column.addWidget(self.mistake)

    def show_goal(self) -> None:
        """Shows the presenter's state."""
        goals = self._goals
        if self.line.text() != goals.text:
            self.line.setText(goals.text)
        diagnostic = goals.diagnostic
        self.mistake.setVisible(diagnostic is not None)
        if diagnostic is not None:
            line = f"line {diagnostic.line}, " if diagnostic.line > 1 else ""
            is_unfinished = diagnostic.position(goals.text) >= len(goals.text.rstrip())
            sign = "…" if is_unfinished else f"⚠ {line}column {diagnostic.column}:"
            self.mistake.setText(f"{sign} {diagnostic.reason}")
            colour_label(self.mistake, "idle" if is_unfinished else "failure")
        self.line.move_popup()
        self.plan.setEnabled(goals.can_plan)
        self.achieve.setEnabled(goals.can_plan)
        missing = "" if goals.has_task_manager else "The task manager is not running"
        self.plan.setToolTip(missing or "Plans the goal and shows what would change; nothing moves  (Enter)")
        self.achieve.setToolTip(missing or "Has the robots reach the goal")
        self.cancel.setEnabled(goals.is_busy)
        self.earlier.setEnabled(bool(goals.history))

    def _fill_menu(self) -> None:
        self._menu.clear()
        for goal in self._goals.history:
            shown = " ".join(goal.split())
            text = shown if len(shown) <= 100 else f"{shown[:99]}…"
            self._menu.addAction(text.replace("&", "&&"), lambda goal=goal: self.line.setText(goal))


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
        self.head.setText(_head(goals))
        self.head.setToolTip(goals.execution.text if goals.execution is not None else "")
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
            text = "\n".join(lines)
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
        return "Write a goal above: Plan shows the steps, Achieve lets the robots execute them."
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
    box.setToolTip(tip)
    return box
