"""The goal as lines of lists: subject, relation or property, object or value; its text below them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QBrush, QStandardItem, QStandardItemModel
from python_qt_binding.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QScrollArea,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.limits import Limits
from skiros2_common.core.names import local_name
from skiros2_common.core.wording import words
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label, tool_button
from skiros2_gui.app.widgets.search_box import SearchBox
from skiros2_gui.app.widgets.theme import role_colour
from skiros2_gui.goal.presenter import GoalPresenter
from skiros2_gui.goal.widgets.text import GoalText
from skiros2_gui.skills.form import Field, ValueMode
from skiros2_gui.skills.widgets.editors import FieldEditor, FieldTarget, editor_of
from skiros2_skill.client.description import Parameter
from skiros2_task.core.goal_choices import Choice, GoalChoices, ValueField
from skiros2_task.core.goal_lines import HOLDS, Line, Term, number_text, value_of

_OPERATOR_TIPS = {HOLDS: "It is true, or has any value"}


class GoalLines(QWidget):
    """Shows and edits the presenter's lines; without any, an empty one. A line with an empty box is not part of the
    goal yet.
    """

    def __init__(self, goals: GoalPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._goals = goals
        self._rows: list[_LineRow] = []
        self._models = _Models()
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
                row = _LineRow(self._models, lambda line, at=index: self._edit(at, line), index)
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
        self._models = _Models(self._goals.choices, self._models)
        for row in self._rows:
            row.set_models(self._models)


class _Model(QStandardItemModel):
    """The entries of a box."""

    def __init__(self, choices: Sequence[Choice]) -> None:
        super().__init__()
        self.choices = choices
        self.terms: list[Term] = []
        self._rows: dict[str, int] = {}
        for choice in choices:
            self._add(choice)

    def _add(self, choice: Choice) -> int:
        term, row = choice.term, len(self.terms)
        self.terms.append(term)
        item = QStandardItem(choice.text)
        if choice.is_faint:
            item.setForeground(QBrush(role_colour("idle")))
        # The data is what typed text is compared with.
        item.setData(f"{term.quantifier} {local_name(term.name)}" if term.quantifier else term.name, Qt.UserRole)
        item.setToolTip(plain_tip(choice.tip))
        self.appendRow(item)
        self._rows[_key(term)] = row
        return row

    def row_of(self, term: Term) -> int:
        """Returns the row of a term; adds one for an unknown term. -1 for none."""
        if not term.name:
            return -1
        row = self._rows.get(_key(term))
        if row is not None:
            return row
        text = f"{term.quantifier} {words(term.name)}" if term.quantifier else term.name
        return self._add(Choice(term, text, term.name))


class _Models:
    """The entries of all lines.

    :param choices: None before the world was read.
    :param before: what they replace. Lists that have not changed stay: to fill one takes Qt 20 ms for 1000 elements.
    """

    def __init__(self, choices: GoalChoices | None = None, before: _Models | None = None) -> None:
        self.choices = choices
        self._before = before._models if before is not None else {}
        self._models: dict[tuple[str, str], _Model] = {}

    def of(self, box: str, line: Line) -> _Model:
        """Returns the entries of a line's box: `subject`, `predicate` or `object`."""
        choices = self.choices
        key = (box, _key(line.subject) if box == "predicate" else line.predicate)
        if key not in self._models:
            found: Sequence[Choice] = ()
            if choices is not None:
                found = choices.predicates(line.subject) if box == "predicate" else (
                    choices.subjects(line.predicate) if box == "subject" else choices.objects(line.predicate)
                )  # fmt: skip
            before = self._before.pop(key, None)
            self._models[key] = before if before is not None and before.choices == found else _Model(found)
        return self._models[key]


class _LineRow(QWidget):
    """The boxes of one line. Its value is entered in an editor of skill parameters.

    :param edit: called with the new line, or with None to remove it.
    """

    def __init__(self, models: _Models, edit: Callable[[Line | None], None], number: int) -> None:
        super().__init__()
        self._models = models
        self._edit = edit
        self._number = number
        self._line = Line()
        self._is_filling = False
        self._field: ValueField | None = None
        self.value: QWidget | None = None
        self.subject = _box(f"goalSubject_{number}", "Element")
        self.negated = QCheckBox("not")
        self.negated.setObjectName(f"goalNot_{number}")
        self.negated.setToolTip("The condition must not hold")
        self.predicate = _box(f"goalPredicate_{number}", "relation or property")
        self.operator = QComboBox()
        self.operator.setObjectName(f"goalOperator_{number}")
        self.object = _box(f"goalObject_{number}", "Element")
        self.text = text_label("", is_selectable=False)
        self.text.setToolTip("Lists cannot express this condition; edit it in the text below")
        remove = tool_button("✕", f"removeCondition_{number}", lambda: edit(None), "Removes this condition")
        self.subject.chosen.connect(lambda row: self._change(subject=self._term("subject", row)))
        self.object.chosen.connect(lambda row: self._change(object=self._term("object", row)))
        self.predicate.chosen.connect(lambda row: self._predicate_chosen(self._term("predicate", row).name))
        self.negated.toggled.connect(lambda is_negated: self._change(is_negated=is_negated))
        self.operator.activated.connect(lambda _: self._change(operator=self.operator.currentText()))
        self._values = QHBoxLayout()
        line = QHBoxLayout(self)
        line.setContentsMargins(0, 0, 0, 0)
        for widget, stretch in ((self.subject, 3), (self.negated, 0), (self.predicate, 2), (self.operator, 0),
                                (self.object, 3), (self.text, 1)):  # fmt: skip
            line.addWidget(widget, stretch)
        line.addLayout(self._values, 3)
        line.addWidget(remove)

    @property
    def is_in_use(self) -> bool:
        """Whether the user is choosing from a list."""
        return self.subject.is_in_use or self.predicate.is_in_use or self.object.is_in_use

    def set_models(self, models: _Models) -> None:
        """Replaces the entries of the boxes."""
        self._models = models
        self._fill()

    def show_line(self, line: Line) -> None:
        """Shows a line."""
        if line != self._line or not line.is_complete:
            self._line = line
            self._fill()

    def _fill(self) -> None:
        choices = self._models.choices
        line = self._line if choices is None else choices.normal(self._line)
        self._is_filling = True
        is_property = bool(line.operator)
        for widget in (self.subject, self.negated, self.predicate):
            widget.setVisible(not line.text)
        self.text.setVisible(bool(line.text))
        self.text.setText(line.text)
        self.operator.setVisible(is_property)
        self.object.setVisible(not is_property and not line.text)
        for name, box, term in (
            ("subject", self.subject, line.subject),
            ("predicate", self.predicate, Term(self._predicate_name(line.predicate))),
            ("object", self.object, line.object),
        ):
            model = self._models.of(name, line)
            if box.model() is not model:
                box.setModel(model)
            id_of = choices.id_of if choices is not None and name != "predicate" and not term.quantifier else _same
            box.show_row(model.row_of(replace(term, name=id_of(term.name) or term.name)))
        self.negated.setChecked(line.is_negated)
        field = choices.field(line) if is_property and choices is not None else ValueField(str)
        self._fill_operators(field, line.operator)
        self._fill_value(field if is_property and line.operator != HOLDS else None, line.value)
        self._is_filling = False

    def _fill_operators(self, field: ValueField, shown: str) -> None:
        operators = [*field.operators, *([shown] if shown not in field.operators else [])]
        if [self.operator.itemText(row) for row in range(self.operator.count())] != operators:
            self.operator.clear()
            self.operator.addItems(operators)
            for row, operator in enumerate(operators):
                self.operator.setItemData(row, _OPERATOR_TIPS.get(operator), Qt.ToolTipRole)
        self.operator.setCurrentIndex(operators.index(shown))

    def _fill_value(self, field: ValueField | None, value: float | str) -> None:
        text = number_text(value) if isinstance(value, float) else value
        if field == self._field and value_of(_text_in(self.value)) == value:
            return  # what the user types stays as it is
        self._field = field
        if self.value is not None:
            self.value.setParent(None)
            self.value.deleteLater()
            self.value = None
        if field is None:
            return
        name = f"goalValue_{self._number}"
        declared = Field(Parameter(self._line.predicate, "required", field.type.__name__, [], limits=field.limits))
        if field.options:
            limits = Limits(field.limits.unit, choices=field.options)
            declared = Field(Parameter(self._line.predicate, "required", "str", [], limits=limits))
        declared.write(text)
        editor = KnownTexts(declared, self, field.known) if field.known else editor_of(declared, self)
        editor.input.setObjectName(name)
        editor.input.setAccessibleName("value")
        if isinstance(editor.input, QLineEdit):
            editor.input.setPlaceholderText(field.limits.text or ("number" if field.is_number else "value"))
        self.value = editor
        self._values.addWidget(editor)

    def _predicate_name(self, name: str) -> str:
        choices = self._models.choices
        known = choices.predicate(name) if choices is not None else None
        return known.text if known is not None else name

    def _term(self, box: str, row: int) -> Term:
        return self._models.of(box, self._line).terms[row]

    def _predicate_chosen(self, name: str) -> None:
        if self._models.choices is not None:
            self._edit(self._models.choices.with_predicate(self._line, name))

    def _change(self, **fields: object) -> None:
        if self._is_filling:
            return
        choices = self._models.choices
        line = self._line if choices is None else choices.normal(self._line)
        self._edit(replace(line, **fields))  # type: ignore[arg-type]

    # -- for the editor of the value ---------------------------------------------------------------------------

    def write(self, key: str, text: str) -> None:
        """Takes the text of the value."""
        self._change(value=value_of(text.strip()))

    def choose_value(self, key: str, value: object) -> None:
        """Takes a boolean or an element from editors of other packages."""
        self._change(value=str(value))

    def set_mode(self, key: str, mode: ValueMode) -> None:
        """Ignored: a value is given."""


class KnownTexts(FieldEditor):
    """A line edit with a list of the texts in the scene."""

    def __init__(self, field: Field, target: FieldTarget, known: Iterable[str]) -> None:
        self.box = QComboBox()
        super().__init__(field, target, self.box)
        self.box.setEditable(True)
        self.box.setInsertPolicy(QComboBox.NoInsert)
        self.box.addItems(list(known))
        self.box.setEditText(field.text)
        self.box.lineEdit().setPlaceholderText("value")
        self.box.editTextChanged.connect(lambda text: target.write(field.key, text))


def _text_in(editor: QWidget | None) -> str:
    """Returns the text in the editor of a value."""
    if not isinstance(editor, FieldEditor):
        return ""
    box = editor.input
    if isinstance(box, QComboBox):
        return str(box.currentText()).strip()
    return str(box.text()).strip() if isinstance(box, QLineEdit) else ""


def _same(name: str) -> str:
    return name


def _key(term: Term) -> str:
    return f"{term.quantifier} {term.name.lower()}"


def _box(name: str, hint: str) -> SearchBox:
    box = SearchBox()
    box.setObjectName(name)
    box.setAccessibleName(hint)
    box.lineEdit().setPlaceholderText(hint)
    box.show_row(-1)
    return box
