"""The selector of a class or template: a tree with a search."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from python_qt_binding.QtCore import QEvent, QModelIndex, QObject, QSortFilterProxyModel, Qt, Signal
from python_qt_binding.QtGui import QKeyEvent, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import QAbstractItemView, QApplication, QLineEdit, QTreeView, QVBoxLayout, QWidget

from skiros2_gui.world.choices import TEMPLATE, Choice

_CHOICE = Qt.UserRole
_KEYS_FOR_THE_TREE = (Qt.Key_Up, Qt.Key_Down, Qt.Key_PageUp, Qt.Key_PageDown)


class ClassChoice(QWidget):
    """The tree of classes and templates. Arrow keys in the search line move the selection."""

    #: The selection has changed.
    changed = Signal()
    #: A choice was double-clicked.
    accepted = Signal()

    def __init__(self, choices: Sequence[Choice], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        model = QStandardItemModel(self)
        for choice in choices:
            model.appendRow(_item(choice))
        self._filter = _Filter(self)
        self._filter.setSourceModel(model)
        self.tree = QTreeView()
        self.tree.setHeaderHidden(True)
        self.tree.setObjectName("classTree")
        self.tree.setEditTriggers(QAbstractItemView.NoEditTriggers)
        self.tree.setModel(self._filter)
        self.tree.expandToDepth(1)
        self.search = QLineEdit()
        self.search.setPlaceholderText("Search classes and templates")
        self.search.setClearButtonEnabled(True)
        self.search.setObjectName("classSearch")
        self.search.installEventFilter(self)
        self.search.textChanged.connect(self._find)
        self.tree.selectionModel().currentChanged.connect(lambda *_: self.changed.emit())
        self.tree.doubleClicked.connect(lambda _: self.accepted.emit())
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.search)
        column.addWidget(self.tree, 1)
        self.setFocusProxy(self.search)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.type() == QEvent.KeyPress and event.key() in _KEYS_FOR_THE_TREE:
            QApplication.sendEvent(self.tree, event)
            return True
        return bool(super().eventFilter(watched, event))

    def chosen(self) -> Choice | None:
        """Returns the selected choice, or None."""
        choice: Choice | None = self.tree.currentIndex().data(_CHOICE)
        return choice

    def choose(self, name: str) -> None:
        """Selects the choice of that name."""
        self._select(index for index in self._rows() if index.data(_CHOICE).name == name)

    def _find(self, text: str) -> None:
        words = text.lower().split()
        self._filter.find(words)
        if words:
            self.tree.expandAll()
            by_name = [i for i in self._rows() if all(word in i.data(_CHOICE).text.lower() for word in words)]
            self._select(by_name or (index for index in self._rows() if index.data(_CHOICE).matches(words)))

    def _select(self, rows: Sequence[QModelIndex] | Iterator[QModelIndex]) -> None:
        index = next(iter(rows), None)
        if index is not None:
            self.tree.setCurrentIndex(index)
            self.tree.scrollTo(index)

    def _rows(self, parent: QModelIndex | None = None) -> Iterator[QModelIndex]:
        above = QModelIndex() if parent is None else parent
        for row in range(self._filter.rowCount(above)):
            index = self._filter.index(row, 0, above)
            yield index
            yield from self._rows(index)


class _Filter(QSortFilterProxyModel):
    """Accepts the choices that match all words, and their ancestors."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._words: list[str] = []
        self.setRecursiveFilteringEnabled(True)

    def find(self, words: list[str]) -> None:
        self._words = words
        self.invalidateFilter()

    def filterAcceptsRow(self, row: int, parent: QModelIndex) -> bool:
        choice: Choice = self.sourceModel().index(row, 0, parent).data(_CHOICE)
        return choice.matches(self._words)


def _item(choice: Choice) -> QStandardItem:
    item = QStandardItem(choice.text)
    item.setData(choice, _CHOICE)
    item.setToolTip("\n".join(line for line in (choice.name, choice.description) if line))
    if choice.kind == TEMPLATE:
        font = item.font()
        font.setItalic(True)
        item.setFont(font)
        item.setText(f"{choice.text}  (template)")
    for child in choice.children:
        item.appendRow(_item(child))
    return item
