"""The editors of parameters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any, Protocol, TypeVar

from python_qt_binding.QtCore import QEvent, QObject, QSignalBlocker, Signal
from python_qt_binding.QtGui import QFontDatabase
from python_qt_binding.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QMenu,
    QPlainTextEdit,
    QToolButton,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_common.core.wording import label_text
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip
from skiros2_gui.app.widgets.search_box import SearchBox
from skiros2_gui.skills.form import Editor, ElementChoice, Field, ValueMode


class FieldTarget(Protocol):
    """Takes what the user enters: the presenter of skills, or a line of a goal."""

    def write(self, key: str, text: str) -> None:
        """Takes the text of a value."""

    def choose_value(self, key: str, value: Any) -> None:
        """Takes an element, by its id, or a boolean."""

    def set_mode(self, key: str, mode: ValueMode) -> None:
        """Takes how the parameter gets its value."""


E = TypeVar("E", bound="FieldEditor")

_UNSET = "unset"

#: A longer list is filled when it gets the focus, which takes time.
_MAX_AT_ONCE = 500

#: The most characters of a recent value in its menu.
_MAX_TEXT = 60


_editors: list[type[FieldEditor]] = []


def register_editor(editor: type[E]) -> type[E]:
    """Registers a kind of editor; a decorator. Of the kinds that accept a field, the one registered last edits it."""
    _editors.insert(0, editor)
    return editor


def editor_of(field: Field, skills: FieldTarget) -> FieldEditor:
    """Returns the editor for a parameter."""
    return next(editor for editor in _editors if editor.accepts(field))(field, skills)


class FieldEditor(QWidget):
    """The base class. `input` is the widget with the focus and the object name.

    A subclass states which fields it `accepts`, is made with the field and the presenter, and passes what the user
    enters to the presenter: `write(key, text)`, `choose_value(key, value)` or `set_mode(key, mode)`.
    """

    @classmethod
    def accepts(cls, field: Field) -> bool:
        """Returns whether it can edit a field."""
        raise NotImplementedError

    def __init__(self, field: Field, skills: FieldTarget, input: QWidget) -> None:
        super().__init__()
        self.field = field
        self.input = input
        self._skills = skills
        input.setObjectName(f"param_{field.key}")
        input.setAccessibleName(field.key)
        input.setToolTip(plain_tip(field.declared.description or field.key))
        self.setFocusProxy(input)
        self.row = QHBoxLayout(self)
        self.row.setContentsMargins(0, 0, 0, 0)
        self.row.addWidget(input, 1)
        input.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.FocusIn:
            self.before_use()
        elif event.type() == QEvent.Wheel and isinstance(watched, QComboBox) and not watched.hasFocus():
            event.ignore()  # the wheel scrolls the form
            return True
        return bool(super().eventFilter(watched, event))

    def before_use(self) -> None:
        """Called when it gets the focus."""

    def show_inferred(self, found: ElementChoice | None, choices: Sequence[ElementChoice]) -> None:
        """Shows the inferred element and the choices."""

    def show_recent(self, values: Sequence[str]) -> None:
        """Offers the values of earlier starts, texts or ids of elements, the newest first."""


class _RecentButton(QToolButton):
    """Opens a menu of earlier values; hidden without one. Emits `picked` with a value."""

    picked = Signal(str)

    def __init__(self, key: str) -> None:
        super().__init__()
        self.setObjectName(f"recent_{key}")
        self.setText("recent")
        self.setToolTip("The values of the last starts")
        self.setPopupMode(QToolButton.InstantPopup)
        self.setMenu(QMenu(self))
        self._values: tuple[str, ...] = ()
        self.hide()

    def show_values(self, values: Sequence[str]) -> None:
        if tuple(values) != self._values:
            self._values = tuple(values)
            self.menu().clear()
            for value in values:
                self.menu().addAction(_one_line(value), partial(self.picked.emit, value))
        self.setVisible(bool(values))


def _one_line(value: str) -> str:
    """Returns a value as the text of a menu, where & marks a key."""
    text = " ".join(value.split()).replace("&", "&&")
    return text if len(text) <= _MAX_TEXT else f"{text[: _MAX_TEXT - 1]}…"


@register_editor
class TextEditor(FieldEditor):
    """A line edit."""

    @classmethod
    def accepts(cls, field: Field) -> bool:
        return True

    def __init__(self, field: Field, skills: FieldTarget) -> None:
        self.line = QLineEdit()
        super().__init__(field, skills, self.line)
        self.line.setText(field.text)
        if ValueMode.UNSET in field.modes:
            self.line.setPlaceholderText(_UNSET)
        self.line.textEdited.connect(lambda text: skills.write(field.key, text))
        self._recent = _RecentButton(field.key)
        self._recent.picked.connect(self._take)
        self.row.addWidget(self._recent)

    def show_recent(self, values: Sequence[str]) -> None:
        self._recent.show_values(values)

    def _take(self, text: str) -> None:
        self.line.setText(text)
        self._skills.write(self.field.key, text)


@register_editor
class NumberEditor(TextEditor):
    """A line edit for numbers, with their unit."""

    @classmethod
    def accepts(cls, field: Field) -> bool:
        return field.editor is Editor.NUMBER

    def __init__(self, field: Field, skills: FieldTarget) -> None:
        super().__init__(field, skills)
        hints = [field.declared.description or field.key, field.limits.text]
        self.line.setToolTip(plain_tip("\n".join(hint for hint in hints if hint)))
        if field.limits.unit:
            self.row.insertWidget(1, PlainLabel(field.limits.unit))


@register_editor
class ChoiceEditor(FieldEditor):
    """A combo box for a boolean, or for the allowed values."""

    @classmethod
    def accepts(cls, field: Field) -> bool:
        return field.editor in (Editor.TRUTH, Editor.CHOICE)

    def __init__(self, field: Field, skills: FieldTarget) -> None:
        self.box = QComboBox()
        super().__init__(field, skills, self.box)
        is_truth = field.editor is Editor.TRUTH
        self._values = [True, False] if is_truth else list(field.options)
        if ValueMode.UNSET in field.modes:
            self.box.addItem(_UNSET)
        self._first = self.box.count()
        self.box.addItems(["yes", "no"] if is_truth else list(field.options))
        current = field.value if is_truth else field.text
        if field.mode is not ValueMode.UNSET and current in self._values:
            self.box.setCurrentIndex(self._first + self._values.index(current))
        elif field.mode is not ValueMode.UNSET:
            self.box.setCurrentIndex(-1)
        self.box.activated.connect(self._chosen)

    def _chosen(self, index: int) -> None:
        if index < self._first:
            self._skills.set_mode(self.field.key, ValueMode.UNSET)
        elif self.field.editor is Editor.TRUTH:
            self._skills.choose_value(self.field.key, self._values[index - self._first])
        else:
            self._skills.write(self.field.key, str(self._values[index - self._first]))


@register_editor
class JsonEditor(FieldEditor):
    """A text edit for a list or mapping in JSON."""

    @classmethod
    def accepts(cls, field: Field) -> bool:
        return field.editor is Editor.JSON

    def __init__(self, field: Field, skills: FieldTarget) -> None:
        self.box = QPlainTextEdit()
        super().__init__(field, skills, self.box)
        self.box.setTabChangesFocus(True)
        self.box.setPlainText(field.text)
        example = {"list": '[1, 2.5, "text"]', "dict": '{"name": "value"}'}.get(field.declared.wire_type, "JSON")
        self.box.setPlaceholderText(_UNSET if ValueMode.UNSET in field.modes else example)
        self.box.setToolTip(plain_tip(f"{field.declared.description or field.key}\nin JSON, such as {example}"))
        self._fit_text()
        self.box.textChanged.connect(lambda: skills.write(field.key, self.box.toPlainText()))
        self._recent = _RecentButton(field.key)
        self._recent.picked.connect(self.box.setPlainText)
        self.row.addWidget(self._recent)

    def show_recent(self, values: Sequence[str]) -> None:
        self._recent.show_values(values)

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._fit_text()

    def _fit_text(self) -> None:
        """Sets the height to three lines."""
        font = QFontDatabase.systemFont(QFontDatabase.FixedFont)
        font.setPointSizeF(self.font().pointSizeF())
        self.box.setFont(font)
        self.box.setFixedHeight(self.box.fontMetrics().lineSpacing() * 3 + 12)


@register_editor
class ElementEditor(FieldEditor):
    """A combo box for elements of the scene, "infer" or "unset"; typed text is searched in labels and ids."""

    @classmethod
    def accepts(cls, field: Field) -> bool:
        return field.editor is Editor.ELEMENT

    def __init__(self, field: Field, skills: FieldTarget) -> None:
        self.box = SearchBox()
        super().__init__(field, skills, self.box)
        self.box.setMinimumContentsLength(18)
        self.box.setToolTip(plain_tip(f"{field.declared.description or field.key}\n{field.type_name}; type to search"))
        self._ids: list[str] = []
        self._labels: Counter[str] = Counter()
        self._shown: tuple[object, ...] = ()
        self._found: ElementChoice | None = None
        self._choices: Sequence[ElementChoice] = ()
        self._recent: Sequence[str] = ()
        self.box.chosen.connect(self._chosen)
        self.show_inferred(None, ())

    def show_inferred(self, found: ElementChoice | None, choices: Sequence[ElementChoice]) -> None:
        choices = sorted(choices, key=self._rank)
        shown = (found, tuple(choices), self.field.mode, self.field.value)
        if shown == self._shown or self.box.is_in_use:
            return
        self._shown, self._found, self._choices = shown, found, choices
        self._fill(found, choices if len(choices) <= _MAX_AT_ONCE else ())

    def show_recent(self, values: Sequence[str]) -> None:
        self._recent = values  # listed first by `show_inferred`

    def _rank(self, choice: ElementChoice) -> int:
        return self._recent.index(choice.id) if choice.id in self._recent else len(self._recent)

    def _fill(self, found: ElementChoice | None, choices: Sequence[ElementChoice]) -> None:
        with QSignalBlocker(self.box):
            self._labels = Counter(choice.label for choice in self._choices)
            items = [(self._mode_text(mode, found), "") for mode in self.field.modes if mode is not ValueMode.GIVEN]
            items += [(self._text(choice), choice.id) for choice in choices]
            self._ids = [eid for _, eid in items]
            value = str(self.field.value or "")
            if self.field.mode is ValueMode.GIVEN and value and value not in self._ids:
                items.append((self._name(value), value))
                self._ids.append(value)
            self.box.clear()
            for text, eid in items:
                self.box.addItem(text, eid)
            self._show_current()

    def before_use(self) -> None:
        if len(self._choices) > _MAX_AT_ONCE and not self.box.lineEdit().isModified():
            self._fill(self._found, self._choices)

    def _name(self, eid: str) -> str:
        """Returns the text of a chosen element that is not in the list."""
        known = next((self._text(choice) for choice in self._choices if choice.id == eid), None)
        return known or (f"{eid}  (not in the scene)" if self._choices else eid)

    def _show_current(self) -> None:
        value = str(self.field.value or "") if self.field.mode is ValueMode.GIVEN else ""
        self.box.show_row(self._ids.index(value) if value in self._ids else -1)

    def _chosen(self, index: int) -> None:
        if self._ids[index]:
            self._skills.choose_value(self.field.key, self._ids[index])
        else:
            mode = next(mode for mode in self.field.modes if mode is not ValueMode.GIVEN)
            self._skills.set_mode(self.field.key, mode)

    def _text(self, choice: ElementChoice) -> str:
        """Returns the label of an element; with the id if other elements have the same label."""
        label = label_text(choice.label)
        if not label:
            return local_name(choice.id)
        return label if self._labels[choice.label] < 2 else f"{label}  ({local_name(choice.id)})"

    def _mode_text(self, mode: ValueMode, found: ElementChoice | None) -> str:
        if mode is ValueMode.UNSET:
            return _UNSET
        return f"infer: {self._text(found)}" if found is not None else "infer: the robot chooses"
