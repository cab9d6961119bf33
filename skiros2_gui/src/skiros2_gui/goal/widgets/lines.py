"""The goal as lines of lists: subject, relation or property, object or value; its text below them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QBrush, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text, verb, words
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label, tool_button
from skiros2_gui.app.widgets.search_box import SearchBox
from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.goal.completion import PROPERTY, RELATION, Completion, Vocabulary
from skiros2_gui.goal.lines import EVERY, HOLDS, OPERATORS, SOME, Line, Term, number_text, value_of
from skiros2_gui.goal.presenter import GoalPresenter
from skiros2_gui.goal.widgets.text import GoalText

_ENTRY = Qt.UserRole + 1  # a Term, or the Completion of a predicate

_OPERATOR_TIPS = {HOLDS: "It is true, or has any value"}


class GoalLines(QWidget):
    """Shows and edits the presenter's lines; without any, an empty one. A line with an empty box is not part of the
    goal yet.
    """

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self._rows: list[_LineRow] = []
        self._choices = _Choices(Vocabulary())
        self.note = PlainLabel()
        self.note.setObjectName("goalLinesNote")
        self.note.setWordWrap(True)
        self.add = push_button(
            "+ Add a condition",
            "addConditionButton",
            lambda: goals.edit_lines([*(goals.lines or (Line(),)), Line()]),
            "Adds a line: a relation between two elements, or a value of a property",
        )
        inside = QWidget()
        self._column = QVBoxLayout(inside)
        self._column.setContentsMargins(0, 0, 4, 0)
        self._column.addStretch(1)
        area = QScrollArea()
        area.setWidgetResizable(True)
        area.setFrameShape(QScrollArea.NoFrame)
        area.setWidget(inside)
        buttons = QHBoxLayout()
        buttons.addWidget(self.add)
        buttons.addWidget(self.note, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 4, 0, 0)
        column.addWidget(area, 1)
        column.addLayout(buttons)
        self.text = GoalText(goals)
        column.addWidget(self.text)
        goals.on_vocabulary = self._read_vocabulary
        self.show_goal()

    def show_goal(self) -> None:
        """Shows the presenter's lines and text."""
        lines = self._goals.lines
        self.text.show_goal()
        self.add.setEnabled(lines is not None)
        if lines is None:
            self.note.setText("The text below has a mistake; the lines follow when it is corrected.")
        elif not lines:
            self.note.setText("Choose an element, a relation or property, and an element or value.")
        else:
            waiting = sum(not line.is_complete for line in lines)
            self.note.setText(f"{waiting} not complete yet" if waiting else "")
        for row in self._rows:
            row.setEnabled(lines is not None)
        if lines is None:
            return
        lines = lines or (Line(),)
        while len(self._rows) > len(lines):
            self._rows.pop().deleteLater()
        for index, line in enumerate(lines):
            if index == len(self._rows):
                row = _LineRow(self._choices, lambda line, at=index: self._edit(at, line), index)
                self._rows.append(row)
                self._column.insertWidget(index, row)
            self._rows[index].show_line(line)

    def _edit(self, index: int, line: Line | None) -> None:
        """Replaces a line; None removes it."""
        lines = list(self._goals.lines or ())
        lines[index : index + 1] = [] if line is None else [line]
        self._goals.edit_lines(lines)

    def _read_vocabulary(self) -> None:
        if any(row.is_in_use for row in self._rows):
            return  # the next vocabulary comes with the next change of the scene
        self._choices = _Choices(self._goals.vocabulary)
        for row in self._rows:
            row.set_choices(self._choices)


class _Choices:
    """The entries of the boxes, shared by all lines."""

    def __init__(self, vocabulary: Vocabulary) -> None:
        self.values = [completion.label for completion in vocabulary.values]
        self.terms = QStandardItemModel()
        labels = Counter(element.label for element in vocabulary.elements)
        self._rows: dict[str, int] = {}
        reachable = [element for element in vocabulary.elements if element.rank == 0]
        self._add_elements(reachable, labels)
        used = [cls for cls in vocabulary.classes if cls.rank == 0]
        for quantifier, of in ((EVERY, "each element"), (SOME, "at least one element")):
            for cls in used:
                term = Term(cls.text, quantifier)
                self._rows[_key(term)] = self.terms.rowCount()
                shown = f"{quantifier} {words(cls.label)}"
                self.terms.appendRow(_item(shown, f"{quantifier} {cls.label}", f"{of} of {cls.text}", term))
        self._add_elements(vocabulary.elements[len(reachable) :], labels)
        names = Counter(predicate.label for predicate in vocabulary.predicates)
        self.predicates = QStandardItemModel()
        self._predicate_rows: dict[str, int] = {}
        for predicate in vocabulary.predicates:
            self._predicate_rows.setdefault(predicate.label.lower(), self.predicates.rowCount())
            self._predicate_rows[predicate.text.lower()] = self.predicates.rowCount()
            tip = f"{predicate.kind} {predicate.text}"
            shown = _predicate_text(predicate)
            shown = shown if names[predicate.label] == 1 else f"{shown}  ({predicate.text})"
            self.predicates.appendRow(_item(shown, predicate.text, tip, predicate, is_faint=predicate.rank > 0))

    def _add_elements(self, elements: Iterable[Completion], labels: Counter[str]) -> None:
        for element in elements:
            eid, label = element.text.strip('"'), label_text(element.label)
            shown = label if labels[element.label] == 1 else f"{label}  ({local_name(eid)})"
            self._rows.setdefault(element.label.lower(), self.terms.rowCount())
            self._rows[eid.lower()] = self.terms.rowCount()
            self.terms.appendRow(_item(shown, eid, eid, Term(eid), is_faint=element.rank > 0))

    def term_row(self, term: Term) -> int:
        """Returns the row of a term; adds one for an unknown term. -1 for none."""
        if not term.name:
            return -1
        key = _key(term) if term.quantifier else term.name.lower()
        if key not in self._rows:
            self._rows[key] = self.terms.rowCount()
            shown = f"{term.quantifier} {words(term.name)}" if term.quantifier else term.name
            self.terms.appendRow(_item(shown, term.name, term.name, term))
        return self._rows[key]

    def predicate_row(self, line: Line) -> int:
        """Returns the row of the predicate; see `term_row`."""
        key = line.predicate.lower()
        if key and key not in self._predicate_rows:
            self._predicate_rows[key] = self.predicates.rowCount()
            entry = Completion(line.predicate, local_name(line.predicate), PROPERTY if line.operator else RELATION)
            self.predicates.appendRow(_item(_predicate_text(entry), line.predicate, line.predicate, entry))
        return self._predicate_rows.get(key, -1)


class _LineRow(QWidget):
    """The boxes of one line.

    :param edit: called with the new line, or with None to remove it.
    """

    def __init__(self, choices: _Choices, edit: Callable[[Line | None], None], number: int) -> None:
        super().__init__()
        self._choices = choices
        self._edit = edit
        self._line = Line()
        self._is_filling = False
        self.subject = _box(f"goalSubject_{number}", "Element", choices.terms)
        self.negated = QCheckBox("not")
        self.negated.setObjectName(f"goalNot_{number}")
        self.negated.setToolTip("The condition must not hold")
        self.predicate = _box(f"goalPredicate_{number}", "relation or property", choices.predicates)
        self.operator = QComboBox()
        self.operator.addItems(OPERATORS)
        for row, operator in enumerate(OPERATORS):
            self.operator.setItemData(row, _OPERATOR_TIPS.get(operator), Qt.ToolTipRole)
        self.object = _box(f"goalObject_{number}", "Element", choices.terms)
        self.value = QComboBox()
        self.value.setObjectName(f"goalValue_{number}")
        self.value.setEditable(True)
        self.value.setInsertPolicy(QComboBox.NoInsert)
        self.value.addItems(choices.values)
        self.value.lineEdit().setPlaceholderText("value")
        self.text = text_label("", is_selectable=False)
        self.text.setToolTip("Lists cannot express this condition; edit it in the text below")
        remove = tool_button("✕", f"removeCondition_{number}", lambda: edit(None), "Removes this condition")
        self.subject.chosen.connect(lambda row: self._change(subject=self._term(row)))
        self.object.chosen.connect(lambda row: self._change(object=self._term(row)))
        self.predicate.chosen.connect(self._predicate_chosen)
        self.negated.toggled.connect(lambda is_negated: self._change(is_negated=is_negated))
        self.operator.activated.connect(lambda row: self._change(operator=OPERATORS[row]))
        self.value.editTextChanged.connect(lambda text: self._change(value=value_of(text.strip())))
        line = QHBoxLayout(self)
        line.setContentsMargins(0, 0, 0, 0)
        for widget, stretch in (
            (self.subject, 3), (self.negated, 0), (self.predicate, 2), (self.operator, 0),
            (self.object, 3), (self.value, 3), (self.text, 1), (remove, 0),
        ):  # fmt: skip
            line.addWidget(widget, stretch)

    @property
    def is_in_use(self) -> bool:
        """Whether the user is choosing from a list."""
        return self.subject.is_in_use or self.predicate.is_in_use or self.object.is_in_use

    def set_choices(self, choices: _Choices) -> None:
        """Replaces the entries of the boxes."""
        self._choices, self._is_filling = choices, True
        for box, model in (
            (self.subject, choices.terms),
            (self.predicate, choices.predicates),
            (self.object, choices.terms),
        ):
            box.setModel(model)
        shown = self.value.currentText()
        self.value.clear()
        self.value.addItems(choices.values)
        self.value.setEditText(shown)
        self._is_filling = False
        self._fill()

    def show_line(self, line: Line) -> None:
        """Shows a line."""
        if line != self._line or not line.is_complete:
            self._line = line
            self._fill()

    def _fill(self) -> None:
        line, self._is_filling = self._line, True
        for widget in (self.subject, self.negated, self.predicate):
            widget.setVisible(not line.text)
        self.text.setVisible(bool(line.text))
        self.text.setText(line.text)
        is_property = bool(line.operator)
        self.operator.setVisible(is_property)
        self.value.setVisible(is_property and line.operator != HOLDS)
        self.object.setVisible(not is_property and not line.text)
        self.subject.show_row(self._choices.term_row(line.subject))
        self.object.show_row(self._choices.term_row(line.object))
        self.predicate.show_row(self._choices.predicate_row(line))
        self.negated.setChecked(line.is_negated)
        if is_property:
            self.operator.setCurrentIndex(OPERATORS.index(line.operator))
        if value_of(self.value.currentText().strip()) != line.value:
            self.value.setEditText(number_text(line.value) if isinstance(line.value, float) else line.value)
        self._is_filling = False

    def _term(self, row: int) -> Term:
        return self._choices.terms.item(row).data(_ENTRY)

    def _predicate_chosen(self, row: int) -> None:
        predicate: Completion = self._choices.predicates.item(row).data(_ENTRY)
        operator = (self._line.operator or "=") if predicate.kind == PROPERTY else ""
        self._change(predicate=predicate.text, operator=operator)

    def _change(self, **fields: object) -> None:
        if not self._is_filling:
            self._edit(replace(self._line, **fields))  # type: ignore[arg-type]


def _key(term: Term) -> str:
    return f"{term.quantifier} {term.name.lower()}"


def _predicate_text(predicate: Completion) -> str:
    return predicate.label if predicate.kind == PROPERTY else verb(predicate.text)


def _item(text: str, data: str, tip: str, entry: object, is_faint: bool = False) -> QStandardItem:
    """Returns an entry.

    :param is_faint: no skill can change it.
    """
    item = QStandardItem(text)
    if is_faint:
        item.setForeground(QBrush(role_colour("idle")))
    item.setData(data, Qt.UserRole)
    item.setData(entry, _ENTRY)
    item.setToolTip(plain_tip(tip))
    return item


def _box(name: str, hint: str, model: QStandardItemModel) -> SearchBox:
    box = SearchBox()
    box.setObjectName(name)
    box.setAccessibleName(hint)
    box.setModel(model)
    box.lineEdit().setPlaceholderText(hint)
    box.show_row(-1)
    return box
