"""The editors of parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence

from python_qt_binding.QtCore import QEvent, QObject, QSignalBlocker, Qt
from python_qt_binding.QtGui import QFontDatabase, QKeyEvent
from python_qt_binding.QtWidgets import QComboBox, QCompleter, QHBoxLayout, QLabel, QLineEdit, QPlainTextEdit, QWidget

from skiros2_gui.skills.fields import Editor, ElementChoice, Field, ValueMode
from skiros2_gui.skills.presenter import SkillsPresenter

_UNSET = "unset"

#: A longer list is filled when it gets the focus, which takes time.
_MAX_AT_ONCE = 500


def editor_of(field: Field, skills: SkillsPresenter) -> FieldEditor:
    """Returns the editor for a parameter."""
    kinds: dict[Editor, type[FieldEditor]] = {
        Editor.ELEMENT: ElementEditor,
        Editor.NUMBER: NumberEditor,
        Editor.TRUTH: ListEditor,
        Editor.CHOICE: ListEditor,
        Editor.JSON: JsonEditor,
        Editor.TEXT: TextEditor,
    }
    return kinds[field.editor](field, skills)


class FieldEditor(QWidget):
    """The base class. `input` is the widget with the focus and the object name."""

    def __init__(self, field: Field, skills: SkillsPresenter, input: QWidget) -> None:
        super().__init__()
        self.field = field
        self.input = input
        self._skills = skills
        input.setObjectName(f"param_{field.key}")
        input.setAccessibleName(field.key)
        input.setToolTip(field.declared.description or field.key)
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


class TextEditor(FieldEditor):
    """A line edit."""

    def __init__(self, field: Field, skills: SkillsPresenter, line: QLineEdit | None = None) -> None:
        self.line = line or QLineEdit()
        super().__init__(field, skills, self.line)
        self.line.setText(field.text)
        if ValueMode.UNSET in field.modes:
            self.line.setPlaceholderText(_UNSET)
        self.line.textEdited.connect(lambda text: skills.write(field.key, text))


class NumberEditor(TextEditor):
    """A line edit for numbers, with arrow keys."""

    def __init__(self, field: Field, skills: SkillsPresenter) -> None:
        super().__init__(field, skills, _NumberLine(field))
        least, most = field.limits
        hints = [field.declared.description or field.key]
        if not math.isinf(least) or not math.isinf(most):
            hints.append(f"from {least:g} to {most:g}".replace("from -inf to", "at most").replace(" to inf", " on"))
        hints.append("up and down change it")
        self.line.setToolTip("\n".join(hints))
        if field.unit:
            self.row.addWidget(QLabel(field.unit))


class _NumberLine(QLineEdit):
    def __init__(self, field: Field) -> None:
        super().__init__()
        self._field = field

    def keyPressEvent(self, event: QKeyEvent) -> None:
        steps = {Qt.Key_Up: 1, Qt.Key_Down: -1, Qt.Key_PageUp: 10, Qt.Key_PageDown: -10}.get(event.key())
        text = self._stepped(steps) if steps is not None else None
        if text is None:
            super().keyPressEvent(event)
            return
        self.setText(text)
        self.textEdited.emit(text)

    def _stepped(self, steps: int) -> str | None:
        """Returns the number changed by some steps, within its limits; None if the text is no number."""
        least, most = self._field.limits
        try:
            value = float(self.text() or 0.0)
        except ValueError:
            return None
        if self._field.declared.wire_type == "int":
            return str(int(min(max(value + steps, least), most)))
        return f"{min(max(value + steps * 0.1, least), most):.10g}"


class ListEditor(FieldEditor):
    """A combo box for a boolean, or for the texts of the description."""

    def __init__(self, field: Field, skills: SkillsPresenter) -> None:
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


class JsonEditor(FieldEditor):
    """A text edit for a list or mapping in JSON."""

    def __init__(self, field: Field, skills: SkillsPresenter) -> None:
        self.box = QPlainTextEdit()
        super().__init__(field, skills, self.box)
        self.box.setTabChangesFocus(True)
        self.box.setPlainText(field.text)
        example = {"list": '[1, 2.5, "text"]', "dict": '{"name": "value"}'}.get(field.declared.wire_type, "JSON")
        self.box.setPlaceholderText(_UNSET if ValueMode.UNSET in field.modes else example)
        self.box.setToolTip(f"{field.declared.description or field.key}\nin JSON, such as {example}")
        self._fit_text()
        self.box.textChanged.connect(lambda: skills.write(field.key, self.box.toPlainText()))


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


class ElementEditor(FieldEditor):
    """A combo box for elements of the scene, "infer" or "unset"; typed text is searched in labels and ids."""

    def __init__(self, field: Field, skills: SkillsPresenter) -> None:
        self.box = QComboBox()
        super().__init__(field, skills, self.box)
        self.box.setEditable(True)
        self.box.setInsertPolicy(QComboBox.NoInsert)
        self.box.setSizeAdjustPolicy(QComboBox.AdjustToMinimumContentsLengthWithIcon)
        self.box.setMinimumContentsLength(18)
        self.box.setMaxVisibleItems(20)
        self.box.setToolTip(f"{field.declared.description or field.key}\n{field.type_name}; type to search")
        completer: QCompleter = self.box.completer()
        completer.setFilterMode(Qt.MatchContains)
        completer.setCompletionMode(QCompleter.PopupCompletion)
        completer.setCaseSensitivity(Qt.CaseInsensitive)
        self._ids: list[str] = []
        self._shown: tuple[object, ...] = ()
        self._found: ElementChoice | None = None
        self._choices: Sequence[ElementChoice] = ()
        self.box.activated.connect(self._chosen)
        self.box.lineEdit().editingFinished.connect(self._typed)
        self.show_inferred(None, ())

    def show_inferred(self, found: ElementChoice | None, choices: Sequence[ElementChoice]) -> None:
        shown = (found, tuple(choices), self.field.mode, self.field.value)
        view = self.box.view()
        if shown == self._shown or (view is not None and view.isVisible()) or self.box.lineEdit().isModified():
            return  # not while the user is choosing
        self._shown, self._found, self._choices = shown, found, choices
        self._fill(found, choices if len(choices) <= _MAX_AT_ONCE else ())

    def _fill(self, found: ElementChoice | None, choices: Sequence[ElementChoice]) -> None:
        with QSignalBlocker(self.box):
            items = [(_words(mode, found), "") for mode in self.field.modes if mode is not ValueMode.GIVEN]
            items += [(choice.text, choice.id) for choice in choices]
            self._ids = [eid for _, eid in items]
            value = str(self.field.value or "")
            if self.field.mode is ValueMode.GIVEN and value and value not in self._ids:
                items.append((self._name(value), value))
                self._ids.append(value)
            self.box.clear()
            self.box.addItems([text for text, _ in items])
            self._show_current()

    def before_use(self) -> None:
        if len(self._choices) > _MAX_AT_ONCE and not self.box.lineEdit().isModified():
            self._fill(self._found, self._choices)

    def _name(self, eid: str) -> str:
        """Returns the text of a chosen element that is not in the list."""
        known = next((choice.text for choice in self._choices if choice.id == eid), None)
        return known or (f"{eid}  (not in the scene)" if self._choices else eid)

    def _show_current(self) -> None:
        value = str(self.field.value or "") if self.field.mode is ValueMode.GIVEN else ""
        self.box.setCurrentIndex(self._ids.index(value) if value in self._ids else -1)
        self.box.lineEdit().setModified(False)
        self.box.lineEdit().setCursorPosition(0)

    def _chosen(self, index: int) -> None:
        self.box.lineEdit().setModified(False)
        if not 0 <= index < len(self._ids):
            return
        if self._ids[index]:
            self._skills.choose_value(self.field.key, self._ids[index])
        else:
            mode = next(mode for mode in self.field.modes if mode is not ValueMode.GIVEN)
            self._skills.set_mode(self.field.key, mode)

    def _typed(self) -> None:
        """Chooses the item whose text, id or label was typed; otherwise restores the current one."""
        line = self.box.lineEdit()
        if not line.isModified():
            return
        text = line.text().strip()
        items = [self.box.itemText(i) for i in range(self.box.count())]
        names = [(item, eid, item.rpartition("  (")[0]) for item, eid in zip(items, self._ids, strict=True)]
        found = [i for i, forms in enumerate(names) if text and text.lower() in (form.lower() for form in forms)]
        line.setModified(False)
        if len(found) == 1:
            self.box.setCurrentIndex(found[0])
            self._chosen(found[0])
        else:
            self._shown = ()
            self._show_current()


def _words(mode: ValueMode, found: ElementChoice | None) -> str:
    if mode is ValueMode.UNSET:
        return _UNSET
    return f"infer: {found.text}" if found is not None else "infer: the robot chooses"
