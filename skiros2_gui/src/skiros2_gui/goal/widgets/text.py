"""The goal as text: a line with completion, and its mistake."""

from __future__ import annotations

import re

from python_qt_binding.QtCore import QEvent, QModelIndex, QRect, Qt
from python_qt_binding.QtGui import QKeyEvent, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import (
    QCompleter,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import PlainLabel, text_label
from skiros2_gui.app.widgets.theme import colour_label
from skiros2_gui.goal.presenter import GoalPresenter
from skiros2_task.core.goal_completion import KEYWORD, Completion

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


class GoalText(QWidget):
    """The goal line, and the mistake in it."""

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self.mistake = text_label("goalMistake", is_selectable=False)
        self.mistake.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.line = GoalLine(goals, self.mistake)
        self.line.returnPressed.connect(goals.make_plan)
        row = QHBoxLayout()
        row.addWidget(PlainLabel("As text"))
        row.addWidget(self.line, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(row)
        column.addWidget(self.mistake)

    def show_goal(self) -> None:
        """Shows the presenter's text and mistake."""
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
