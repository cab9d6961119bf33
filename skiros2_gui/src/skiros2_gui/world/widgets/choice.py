"""Selectors with a search: classes and templates, elements."""

from __future__ import annotations

from collections.abc import Sequence

from python_qt_binding.QtCore import QEvent, QObject, Qt, Signal
from python_qt_binding.QtGui import QKeyEvent
from python_qt_binding.QtWidgets import (
    QApplication,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.world.choices import TEMPLATE, Choice, element_choices
from skiros2_gui.world.presenter import WorldPresenter

_KEYS_FOR_THE_LIST = (Qt.Key_Up, Qt.Key_Down, Qt.Key_PageUp, Qt.Key_PageDown)


class SearchLine(QLineEdit):
    """A search line; arrow keys move the selection in the list.

    :param below: the list or tree.
    """

    def __init__(self, below: QWidget, text: str) -> None:
        super().__init__()
        self._below = below
        self.setPlaceholderText(text)
        self.setClearButtonEnabled(True)
        self.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if isinstance(event, QKeyEvent) and event.type() == QEvent.KeyPress and event.key() in _KEYS_FOR_THE_LIST:
            QApplication.sendEvent(self._below, event)
            return True
        return super().eventFilter(watched, event)


class ClassChoice(QWidget):
    """The tree of classes and templates."""

    #: The selection has changed.
    changed = Signal()
    #: A choice was double-clicked.
    accepted = Signal()

    def __init__(self, choices: Sequence[Choice], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.tree = QTreeWidget()
        self.tree.setHeaderHidden(True)
        self.tree.setObjectName("classTree")
        self.search = SearchLine(self.tree, "Search classes and templates")
        self.search.setObjectName("classSearch")
        self._items: list[tuple[QTreeWidgetItem, Choice]] = []
        for choice in choices:
            self._fill(self.tree.invisibleRootItem(), choice)
        self.tree.expandToDepth(1)
        self.search.textChanged.connect(self._filter)
        self.tree.currentItemChanged.connect(lambda *_: self.changed.emit())
        self.tree.itemDoubleClicked.connect(lambda *_: self.accepted.emit())
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.search)
        column.addWidget(self.tree, 1)
        self.setFocusProxy(self.search)

    def chosen(self) -> Choice | None:
        """Returns the selected choice, or None."""
        item = self.tree.currentItem()
        return next((choice for one, choice in self._items if one is item), None)

    def choose(self, name: str) -> None:
        """Selects the choice of that name."""
        for item, choice in self._items:
            if choice.name == name:
                self.tree.setCurrentItem(item)
                self.tree.scrollToItem(item)
                return

    def _fill(self, above: QTreeWidgetItem, choice: Choice) -> None:
        item = QTreeWidgetItem(above, [choice.text])
        item.setToolTip(0, "\n".join(line for line in (choice.name, choice.description) if line))
        if choice.kind == TEMPLATE:
            font = item.font(0)
            font.setItalic(True)
            item.setFont(0, font)
            item.setText(0, f"{choice.text}  (template)")
        self._items.append((item, choice))
        for child in choice.children:
            self._fill(item, child)

    def _filter(self, text: str) -> None:
        words = text.lower().split()
        first: QTreeWidgetItem | None = None
        for item, choice in reversed(self._items):  # children before their parents
            is_found = choice.matches(words)
            has_found = any(not item.child(i).isHidden() for i in range(item.childCount()))
            item.setHidden(not is_found and not has_found)
            if words and has_found:
                item.setExpanded(True)
            first = item if is_found else first
        if words and first is not None:
            best = next((i for i, c in self._items if all(word in c.text.lower() for word in words)), first)
            self.tree.setCurrentItem(best)
            self.tree.scrollToItem(best)


class ElementChoice(QWidget):
    """The list of elements, and of templates that match the search.

    :param without: an id to leave out.
    """

    changed = Signal()
    accepted = Signal()

    def __init__(self, presenter: WorldPresenter, without: str = "", parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._without = without
        self._types: tuple[str, ...] = ()
        self.list = QListWidget()
        self.list.setObjectName("elementList")
        self.list.setUniformItemSizes(True)
        self.search = SearchLine(self.list, "Search elements")
        self.search.setObjectName("elementSearch")
        self.search.textChanged.connect(lambda _: self._fill())
        self.list.currentItemChanged.connect(lambda *_: self.changed.emit())
        self.list.itemDoubleClicked.connect(lambda *_: self.accepted.emit())
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.search)
        column.addWidget(self.list, 1)
        self.setFocusProxy(self.search)
        self._fill()

    def chosen(self) -> str:
        """Returns the id of the selected element, or ""."""
        item = self.list.currentItem()
        return str(item.data(Qt.UserRole)) if item is not None else ""

    def choose(self, eid: str) -> None:
        """Selects an element."""
        for row in range(self.list.count()):
            if self.list.item(row).data(Qt.UserRole) == eid:
                self.list.setCurrentRow(row)

    def prefer(self, types: Sequence[str]) -> None:
        """Lists instances of these classes first."""
        if self._types != tuple(types):
            self._types = tuple(types)
            self._fill()

    def _fill(self) -> None:
        hierarchy, vocabulary = self._presenter.hierarchy, self._presenter.vocabulary
        if hierarchy is None or vocabulary is None:
            return
        before = self.chosen()
        self.list.clear()
        for eid, name in element_choices(hierarchy, vocabulary, self._types, self.search.text(), self._without):
            item = QListWidgetItem(name, self.list)
            item.setData(Qt.UserRole, eid)
            item.setToolTip(eid)
        self.choose(before)
        if self.list.currentRow() < 0:
            self.list.setCurrentRow(0)
