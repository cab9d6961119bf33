"""The line that goals are written in, which completes the words."""

from __future__ import annotations

import re

from python_qt_binding.QtCore import QEvent, QModelIndex, QRect, Qt
from python_qt_binding.QtGui import QKeyEvent, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import QCompleter, QLabel, QLineEdit, QWidget

from skiros2_gui.goal.completion import WORD, Completion
from skiros2_gui.goal.presenter import GoalPresenter

_TEXT = Qt.UserRole
_REST_OF_WORD = re.compile(r'^[^\s(),";]+')


class GoalLine(QLineEdit):
    """Tells the presenter what is written. Ctrl+space suggests words also where nothing is typed.

    Tab and Enter insert the suggested word. In a goal that is complete Enter does so only for a word that was chosen
    with the arrow keys; else it looks for a plan.

    :param below: a label below the line, which the suggestions do not cover.
    """

    def __init__(self, goals: GoalPresenter, below: QLabel, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self._below = below
        self._start = 0
        self._words: dict[str, str] = {}
        self.setObjectName("goalLine")
        self.setAccessibleName("Goal")
        self.setPlaceholderText("Goal, such as (skiros:contain box product)    Ctrl+space: words")
        self.setToolTip(
            "What is to be so: (relation element element), (not (…)), (forall (?x - class) (…)).\n"
            "Several goals are parted by commas. Words are suggested as you type; Enter looks for a plan."
        )
        self.setClearButtonEnabled(True)
        self._model = QStandardItemModel(self)
        self._completer = QCompleter(self._model, self)
        self._completer.setWidget(self)
        self._completer.setCompletionMode(QCompleter.UnfilteredPopupCompletion)
        self._completer.setMaxVisibleItems(12)
        self._completer.activated[QModelIndex].connect(self._insert)
        self.textChanged.connect(goals.write)
        self.textEdited.connect(self._edited)
        self.cursorPositionChanged.connect(lambda *_: self._completer.popup().isVisible() and self.show_completions())

    def _edited(self, text: str) -> None:
        self._goals.write(text)  # `textEdited` comes before `textChanged`
        self.show_completions()

    def show_completions(self, even_if_empty: bool = False) -> None:
        """Shows the words that may be written at the cursor."""
        found = self._goals.completions(self.cursorPosition())
        typed = self.text()[found.start : self.cursorPosition()]
        words = [word for word in found.items if word.text != typed]
        popup = self._completer.popup()
        if not words or not (typed or even_if_empty or self.text()[: self.cursorPosition()].endswith("(")):
            popup.hide()
            return
        self._start = found.start
        self._model.clear()
        for word in words:
            self._model.appendRow(_item(word))
        self._completer.complete(self._area())
        popup.setCurrentIndex(self._model.index(0, 0))

    def move_popup(self) -> None:
        """Moves the suggestions, if they are shown, so that they do not cover the label below."""
        if self._completer.popup().isVisible():
            self._completer.complete(self._area())

    def _area(self) -> QRect:
        """The cursor and all below it down to the end of the label; the suggestions are shown under it."""
        popup = self._completer.popup()
        width = popup.sizeHintForColumn(0) + popup.verticalScrollBar().sizeHint().width() + 12
        area = self.cursorRect()
        area.setWidth(min(max(width, 160), max(self.width(), 160)))
        label = max(self._below.heightForWidth(self._below.width()), self.fontMetrics().lineSpacing())
        area.setBottom(self.height() + label + self.fontMetrics().lineSpacing() // 2)
        return area

    def event(self, event: QEvent) -> bool:
        if event.type() == QEvent.KeyPress and event.key() == Qt.Key_Tab and self._completer.popup().isVisible():
            self._insert(self._completer.popup().currentIndex())
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        popup = self._completer.popup()
        if event.key() == Qt.Key_Space and event.modifiers() == Qt.ControlModifier:
            self.show_completions(even_if_empty=True)
        elif event.key() not in (Qt.Key_Return, Qt.Key_Enter) or not popup.isVisible():
            super().keyPressEvent(event)
        elif self._goals.is_complete and popup.currentIndex().row() == 0:
            popup.hide()
            super().keyPressEvent(event)
            event.accept()
        else:
            event.ignore()  # so the completer takes it

    def _insert(self, index: QModelIndex) -> None:
        """A suggested word takes the place of what is typed of it, also after the cursor."""
        word = str(index.data(_TEXT))
        self._completer.popup().hide()
        text, cursor = self.text(), self.cursorPosition()
        after = text[cursor:] if self._start == cursor else _REST_OF_WORD.sub("", text[cursor:], count=1)
        gap = "" if word == "(" or after.startswith((" ", ")")) else " "
        self.setText(f"{text[: self._start]}{word}{gap}{after}")
        self.setCursorPosition(self._start + len(word) + len(gap))


def _item(word: Completion) -> QStandardItem:
    more = "" if word.kind == WORD else f"   {word.kind}" + (f" {word.text}" if word.text != word.label else "")
    item = QStandardItem(f"{word.label}{more}")
    item.setData(word.text, _TEXT)
    item.setEditable(False)
    return item
