"""The line that goals are written in, which completes the words."""

from __future__ import annotations

from python_qt_binding.QtCore import QModelIndex, Qt
from python_qt_binding.QtGui import QKeyEvent, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import QCompleter, QLineEdit, QWidget

from skiros2_gui.core.goal_presenter import GoalPresenter
from skiros2_gui.core.goal_words import WORD, Word

_TEXT = Qt.UserRole


class GoalLine(QLineEdit):
    """Tells the presenter what is written. Ctrl+space suggests words also where nothing is typed."""

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
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
        self.textEdited.connect(lambda _: self.suggest())

    def suggest(self, even_if_empty: bool = False) -> None:
        """Shows the words that may be written at the cursor."""
        found = self._goals.suggestions(self.cursorPosition())
        typed = self.text()[found.start : self.cursorPosition()]
        words = [word for word in found.words if word.text != typed]
        popup = self._completer.popup()
        if not words or not (typed or even_if_empty or self.text()[: self.cursorPosition()].endswith("(")):
            popup.hide()
            return
        self._start = found.start
        self._model.clear()
        for word in words:
            self._model.appendRow(_item(word))
        width = popup.sizeHintForColumn(0) + popup.verticalScrollBar().sizeHint().width() + 12
        area = self.cursorRect()
        area.setWidth(min(max(width, 160), max(self.width(), 160)))
        self._completer.complete(area)
        popup.setCurrentIndex(self._model.index(0, 0))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() == Qt.Key_Space and event.modifiers() == Qt.ControlModifier:
            self.suggest(even_if_empty=True)
            return
        super().keyPressEvent(event)

    def _insert(self, index: QModelIndex) -> None:
        """A suggested word takes the place of what is typed of it."""
        word = str(index.data(_TEXT))
        text, cursor = self.text(), self.cursorPosition()
        after = text[cursor:]
        gap = "" if word == "(" or after.startswith((" ", ")")) else " "
        self.setText(f"{text[: self._start]}{word}{gap}{after}")
        self.setCursorPosition(self._start + len(word) + len(gap))


def _item(word: Word) -> QStandardItem:
    more = "" if word.kind == WORD else f"   {word.kind}" + (f" {word.text}" if word.text != word.shown else "")
    item = QStandardItem(f"{word.shown}{more}")
    item.setData(word.text, _TEXT)
    item.setEditable(False)
    return item
