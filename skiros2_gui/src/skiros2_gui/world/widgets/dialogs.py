"""The dialogs of the tab, and their selector of a class or template."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from python_qt_binding.QtCore import QEvent, QModelIndex, QObject, QSortFilterProxyModel, Qt, Signal
from python_qt_binding.QtGui import QKeyEvent, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QApplication,
    QCheckBox,
    QComboBox,
    QCompleter,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QLineEdit,
    QPlainTextEdit,
    QTreeView,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import full_name, local_name
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip
from skiros2_gui.app.widgets.search_box import SearchBox
from skiros2_gui.world.choices import CLASS, TEMPLATE, Choice, class_choices, element_choices, predicate_choices
from skiros2_gui.world.details import Details, PropertyRow, display_name
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.requests import CONTAINS
from skiros2_world_model.core.vocabulary import Vocabulary

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
    item.setToolTip(plain_tip("\n".join(line for line in (choice.name, choice.description) if line)))
    if choice.kind == TEMPLATE:
        font = item.font()
        font.setItalic(True)
        item.setFont(font)
        item.setText(f"{choice.text}  (template)")
    for child in choice.children:
        item.appendRow(_item(child))
    return item


#: The most elements named.
_MAX_NAMED = 12


class _Dialog(QDialog):
    """A dialog with OK, Cancel and a note."""

    def __init__(self, title: str, ok: str, parent: QWidget | None) -> None:
        super().__init__(parent)
        self.setWindowTitle(title)
        self.content = QVBoxLayout()
        self.note = PlainLabel()
        self.note.setObjectName("note")
        self.note.setWordWrap(True)
        self.buttons = QDialogButtonBox(QDialogButtonBox.Ok | QDialogButtonBox.Cancel)
        self.ok = self.buttons.button(QDialogButtonBox.Ok)
        self.ok.setText(ok)
        self.buttons.accepted.connect(self.accept)
        self.buttons.rejected.connect(self.reject)
        column = QVBoxLayout(self)
        column.addLayout(self.content, 1)
        column.addWidget(self.note)
        column.addWidget(self.buttons)

    def size_to(self, width: float, height: float) -> None:
        """Sets the size, in line heights."""
        em = self.fontMetrics().height()
        self.resize(int(width * em), int(height * em))


class AddDialog(_Dialog):
    """Adds an element of a class, or a template with its parts.

    :param parent_id: the parent.
    """

    def __init__(self, presenter: WorldPresenter, parent_id: str, parent: QWidget | None = None) -> None:
        super().__init__("Add an element", "Add", parent)
        self._presenter = presenter
        hierarchy, vocabulary = presenter.hierarchy, presenter.vocabulary
        assert hierarchy is not None and vocabulary is not None
        self._vocabulary = vocabulary
        self._parent_id = parent_id
        self.choice = ClassChoice(class_choices(vocabulary))
        self.label = QLineEdit()
        self.label.setObjectName("newLabel")
        self.label.setPlaceholderText("none")
        self.relation = QComboBox()
        self.relation.setObjectName("newRelation")
        for name in sorted(vocabulary.spatial, key=lambda name: (name != CONTAINS, name)):
            self.relation.addItem(local_name(name), name)
            self.relation.setItemData(self.relation.count() - 1, vocabulary.description(name), Qt.ToolTipRole)
        self.in_space = QCheckBox("It has a pose")
        self.in_space.setChecked(True)
        self.in_space.setToolTip("Gives it a frame and a pose, which the world model maintains and publishes")
        form = QFormLayout()
        form.addRow("Parent", PlainLabel(display_name(hierarchy, parent_id)))
        form.addRow("Relation", self.relation)
        form.addRow("Label", self.label)
        form.addRow("", self.in_space)
        self.content.addWidget(self.choice, 1)
        self.content.addLayout(form)
        self.choice.changed.connect(self._show)
        self.choice.accepted.connect(self._take)
        self.choice.setFocus()
        self.size_to(28, 34)
        self._show()

    def accept(self) -> None:
        choice = self.choice.chosen()
        if choice is None:
            return
        under, relation = self._parent_id, self.relation.currentData()
        label, in_space = self.label.text().strip(), self.in_space.isChecked()
        if choice.kind == CLASS:
            self._presenter.add(f"add {choice.text}", lambda r: r.add(choice.name, label, under, relation, in_space))
        else:
            self._presenter.add(f"add {choice.text}", lambda r: r.add_template(choice.name, under, relation))
        super().accept()

    def _take(self) -> None:
        choice = self.choice.chosen()
        if choice is not None and not choice.children:
            self.accept()

    def _show(self) -> None:
        choice = self.choice.chosen()
        self.ok.setEnabled(choice is not None)
        is_class = choice is not None and choice.kind == CLASS
        self.label.setEnabled(is_class)
        self.in_space.setEnabled(is_class)
        self.note.setText("" if choice is None else choice.description or choice.name)


class ClassDialog(_Dialog):
    """Changes the class of an element."""

    chosen = Signal(str)

    def __init__(self, vocabulary: Vocabulary, etype: str, parent: QWidget | None = None) -> None:
        super().__init__("Change the class", "Change", parent)
        self.choice = ClassChoice(class_choices(vocabulary, with_templates=False))
        self.content.addWidget(self.choice)
        self.choice.changed.connect(self._show)
        self.choice.choose(etype)
        self.size_to(28, 30)
        self._show()

    def accept(self) -> None:
        choice = self.choice.chosen()
        if choice is not None:
            self.chosen.emit(choice.name)
            super().accept()

    def _show(self) -> None:
        choice = self.choice.chosen()
        self.ok.setEnabled(choice is not None)
        self.note.setText("" if choice is None else choice.description or choice.name)


class RemoveDialog(_Dialog):
    """Confirms the removal of elements and their descendants."""

    def __init__(self, presenter: WorldPresenter, ids: Sequence[str], removed: Sequence[str], parent: QWidget) -> None:
        super().__init__("Remove", "Remove", parent)
        hierarchy = presenter.hierarchy
        assert hierarchy is not None
        others = [eid for eid in removed if eid not in ids]
        text = f"Remove {', '.join(display_name(hierarchy, eid) for eid in ids[:3])}"
        text += f" and {len(ids) - 3} more" if len(ids) > 3 else ""
        self.text = PlainLabel(f"{text}?")
        self.text.setWordWrap(True)
        self.content.addWidget(self.text)
        if others:
            names = [display_name(hierarchy, eid) for eid in others[:_MAX_NAMED]]
            more = [f"and {len(others) - _MAX_NAMED} more"] if len(others) > _MAX_NAMED else []
            self.note.setText(f"Also removes {_counted(len(others))} below it:\n" + "\n".join([*names, *more]))
        else:
            self.note.setText("No other element is removed.")
        self.content.addStretch(1)
        self.setMinimumWidth(24 * self.fontMetrics().height())


class RelationDialog(_Dialog):
    """Adds a relation.

    :param eid: the element.
    """

    def __init__(self, presenter: WorldPresenter, eid: str, parent: QWidget | None = None) -> None:
        super().__init__("Add a relation", "Add", parent)
        self._presenter = presenter
        self._eid = eid
        hierarchy, vocabulary = presenter.hierarchy, presenter.vocabulary
        assert hierarchy is not None and vocabulary is not None
        self._vocabulary = vocabulary
        record = hierarchy.scene.record(eid)
        self.predicate = SearchBox()
        self.predicate.setObjectName("relationChoice")
        for predicate, matches in predicate_choices(vocabulary, record.type if record is not None else ""):
            text = local_name(predicate.name)
            self.predicate.addItem(text if matches else f"{text}  (other domain)", predicate.name)
            tip = "\n".join(line for line in (predicate.name, predicate.description) if line)
            self.predicate.setItemData(self.predicate.count() - 1, tip, Qt.ToolTipRole)
        self.predicate.show_row(0)
        self.direction = QComboBox()
        self.direction.setObjectName("relationDirection")
        name = display_name(hierarchy, eid)
        self.direction.addItems((f"from {name}", f"to {name}"))
        self.other = SearchBox()
        self.other.setObjectName("relationElement")
        self.other.lineEdit().setPlaceholderText("an element or a template")
        self._types: tuple[str, ...] | None = None  # listed first
        form = QFormLayout()
        form.addRow("Relation", self.predicate)
        form.addRow("Direction", self.direction)
        form.addRow("Element", self.other)
        self.content.addLayout(form)
        self.content.addStretch(1)
        self.predicate.chosen.connect(lambda _: self._show())
        self.direction.currentIndexChanged.connect(lambda _: self._show())
        self.other.chosen.connect(lambda _: self._show())
        self.size_to(28, 14)
        self._show()

    @property
    def relation(self) -> tuple[str, str, str]:
        """The selected subject, relation and object."""
        predicate, other = self.predicate.value, self.other.value
        return (self._eid, predicate, other) if self.direction.currentIndex() == 0 else (other, predicate, self._eid)

    def accept(self) -> None:
        if not self.ok.isEnabled():
            return
        relation = self.relation
        self._presenter.change(f"add {local_name(relation[1])}", lambda r: r.relate(*relation))
        super().accept()

    def _show(self) -> None:
        src, predicate, dst = self.relation
        known = self._vocabulary.predicate(predicate)
        self._prefer(known.range if self.direction.currentIndex() == 0 else known.domain)
        requests = self._presenter.requests
        mismatch = requests.mismatch(src, predicate, dst) if requests is not None and src and dst else ""
        self.ok.setEnabled(bool(src and predicate and dst))
        self.note.setText(f"⚠ {mismatch}" if mismatch else known.description or predicate)

    def _prefer(self, types: tuple[str, ...]) -> None:
        """Lists instances of these classes first."""
        hierarchy = self._presenter.hierarchy
        if types == self._types or hierarchy is None:
            return
        self._types = types
        other = self.other.value
        self.other.clear()
        for eid, name in element_choices(hierarchy, self._vocabulary, types, self._eid):
            self.other.addItem(name, eid)
        self.other.show_value(other)


class PropertyDialog(_Dialog):
    """Adds a property."""

    #: Emits the property and its values as texts.
    chosen = Signal(str, list)

    def __init__(self, vocabulary: Vocabulary, details: Details, parent: QWidget | None = None) -> None:
        super().__init__("Add a property", "Add", parent)
        self._vocabulary = vocabulary
        self._details = details
        had = {row.key for row in details.properties}
        self.key = QComboBox()
        self.key.setObjectName("newProperty")
        self.key.setEditable(True)
        self.key.setInsertPolicy(QComboBox.NoInsert)
        for key in vocabulary.data_properties():
            if key not in had:
                self.key.addItem(local_name(key) if key.startswith("skiros:") else key, key)
                self.key.setItemData(self.key.count() - 1, vocabulary.description(key), Qt.ToolTipRole)
        self.key.completer().setCompletionMode(QCompleter.PopupCompletion)
        self.key.completer().setFilterMode(Qt.MatchContains)
        self.key.setCurrentIndex(-1)
        self.key.lineEdit().setPlaceholderText("its name")
        self.value = QLineEdit()
        self.value.setObjectName("newValue")
        form = QFormLayout()
        form.addRow("Property", self.key)
        form.addRow("Value", self.value)
        self.content.addLayout(form)
        self.content.addStretch(1)
        self.key.editTextChanged.connect(lambda _: self._show())
        self.value.textChanged.connect(lambda _: self._show())
        self.size_to(28, 12)
        self._show()

    @property
    def name(self) -> str:
        """The full name of the selected property."""
        text = self.key.currentText().strip()
        return full_name(text) if text else ""

    def accept(self) -> None:
        if self.ok.isEnabled():
            self.chosen.emit(self.name, [self.value.text()] if self.value.text() else [])
            super().accept()

    def _show(self) -> None:
        key = self.name
        wrong = ""
        if key and self.value.text():
            try:
                self._vocabulary.parsed(self._details.type, key, self.value.text())
            except WrongValue as error:
                wrong = str(error)
        unit = self._vocabulary.unit(key)
        self.value.setPlaceholderText(f"in {unit}" if unit else "")
        self.ok.setEnabled(bool(key) and not wrong)
        note = self._vocabulary.description(key)
        if key and not note and not self._vocabulary.is_declared(key):
            note = "The ontologies do not declare this property."
        self.note.setText(f"⚠ {wrong}" if wrong else note)


class ValuesDialog(_Dialog):
    """Edits the values of a property, one per line; a single string may have several lines."""

    chosen = Signal(list)

    def __init__(self, row: PropertyRow, parent: QWidget | None = None) -> None:
        super().__init__(row.name, "Write", parent)
        self._is_one_text = row.kind is str and len(row.values) == 1
        self.box = QPlainTextEdit()
        self.box.setPlainText("\n".join(row.texts))
        self.content.addWidget(self.box)
        unit = f" in {row.unit}" if row.unit else ""
        form = "" if row.is_plain else ", as JSON"
        self.note.setText("One text" if self._is_one_text else f"One {row.kind_text}{unit} on each line{form}")
        self.size_to(24, 16)

    def accept(self) -> None:
        text = self.box.toPlainText()
        self.chosen.emit([text] if self._is_one_text else [line for line in text.splitlines() if line.strip()])
        super().accept()


def _counted(number: int) -> str:
    return "one element" if number == 1 else f"{number} elements"
