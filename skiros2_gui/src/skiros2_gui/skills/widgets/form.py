"""The start form: parameters, status and start buttons."""

from __future__ import annotations

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtWidgets import (
    QFormLayout,
    QFrame,
    QHBoxLayout,
    QLabel,
    QPlainTextEdit,
    QScrollArea,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import SPACE_TOGGLES, PlainLabel, plain_tip, push_button, text_label
from skiros2_gui.app.widgets.theme import colour_label
from skiros2_gui.skills.form import Field, ValueMode
from skiros2_gui.skills.presenter import SkillsPresenter
from skiros2_gui.skills.start_status import READY, REFUSED, start_status
from skiros2_gui.skills.widgets.editors import FieldEditor, editor_of

_SIGNS = {READY: "✓", REFUSED: "✕"}
_ROLE_COLOURS = {READY: "success", REFUSED: "failure"}


class SkillForm(QWidget):
    """Shows the presenter's form and status."""

    def __init__(self, skills: SkillsPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._skills = skills
        self._editors: dict[str, FieldEditor] = {}
        self._errors: dict[str, QLabel] = {}
        self._hints: list[QLabel] = []
        self.title = PlainLabel()
        self.title.setTextFormat(Qt.PlainText)
        self.reset = QToolButton()
        self.reset.setText("Reset")
        self.reset.setToolTip("Sets all parameters to what the skill declares")
        self.reset.clicked.connect(skills.reset)
        self.purpose = text_label("skillPurpose")
        head = QHBoxLayout()
        head.addWidget(self.title, 1)
        head.addWidget(self.reset)
        self.area = QScrollArea()
        self.area.setObjectName("parameters")
        self.area.setWidgetResizable(True)
        self.area.setFrameShape(QFrame.NoFrame)
        self.area.setHorizontalScrollBarPolicy(Qt.ScrollBarAlwaysOff)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(head)
        column.addWidget(self.purpose)
        column.addWidget(self.area, 1)
        column.addWidget(self._why_not())
        column.addSpacing(1)
        column.addLayout(self._buttons())
        self._fit_text()
        skills.on_form = self.show_form
        skills.on_preview = self.show_status
        self.show_form()

    def changeEvent(self, event: QEvent) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._fit_text()

    def _fit_text(self) -> None:
        """Follows the text size."""
        font = self.font()
        font.setBold(True)
        font.setPointSizeF(font.pointSizeF() * 1.2)
        self.title.setFont(font)
        self.details.setMaximumHeight(self.fontMetrics().lineSpacing() * 9)

    def _why_not(self) -> QWidget:
        frame = QFrame()
        frame.setFrameShape(QFrame.StyledPanel)
        self.sign = PlainLabel()
        self.why_not = text_label("whyNot")
        self.why_not.setSizePolicy(QSizePolicy.Ignored, QSizePolicy.Preferred)
        self.more = QToolButton()
        self.more.setObjectName("whyNotMore")
        self.more.setText("Why?")
        self.more.setCheckable(True)
        self.more.setToolTip("Shows what the conditions found in the scene")
        self.details = QPlainTextEdit()
        self.details.setObjectName("whyNotDetails")
        self.details.setReadOnly(True)
        self.details.hide()
        self.more.toggled.connect(lambda _: self.show_status())
        row = QHBoxLayout()
        row.addWidget(self.sign, 0, Qt.AlignTop)
        row.addWidget(self.why_not, 1)
        row.addWidget(self.more, 0, Qt.AlignTop)
        column = QVBoxLayout(frame)
        column.setContentsMargins(6, 4, 6, 4)
        column.addLayout(row)
        column.addWidget(self.details)
        return frame

    def _buttons(self) -> QHBoxLayout:
        self.start = push_button(
            "▶ Start",
            "startButton",
            lambda: self._skills.start(),
            "Starts the skill as a task of its own  (space; again: stops it)",
        )
        self.step = push_button(
            "Start paused",
            "startPausedButton",
            lambda: self._skills.start(ticks_once=True),
            "Starts the skill, ticks it once and pauses it",
        )
        for button in (self.start, self.step):
            button.setProperty(SPACE_TOGGLES, True)
        row = QHBoxLayout()
        row.addWidget(self.start, 1)
        row.addWidget(self.step)
        return row

    def show_form(self) -> None:
        """Shows the parameters of the chosen skill."""
        form = self._skills.form
        self._editors, self._errors, self._hints = {}, {}, []
        inside = QWidget()
        rows = QFormLayout(inside)
        rows.setContentsMargins(0, 0, 6, 0)
        rows.setFieldGrowthPolicy(QFormLayout.AllNonFixedFieldsGrow)
        rows.setRowWrapPolicy(QFormLayout.WrapLongRows)
        for field in form.fields.values() if form is not None else ():
            rows.addRow(self._label(field), self._field(field))
        if form is not None and not form.fields:
            rows.addRow(PlainLabel("This skill has no parameters."))
        self.area.setWidget(inside)
        self.title.setText(f"{form.offer.name}  of  {form.offer.manager.lstrip('/')}" if form is not None else "")
        self.title.setToolTip(plain_tip(form.offer.type if form is not None else ""))
        self.reset.setVisible(form is not None)
        self.show_status()

    def show_status(self) -> None:
        """Shows the status, and the errors and recent values of the fields."""
        skills = self._skills
        self.purpose.setText(skills.purpose)
        self.purpose.setVisible(bool(self.purpose.text()))
        status = start_status(skills)
        self.sign.setText(_SIGNS.get(status.status, "…"))
        colour_label(self.sign, _ROLE_COLOURS.get(status.status, ""))
        self.why_not.setText(status.text)
        self.why_not.setToolTip(plain_tip("\n".join(status.details)))
        self.more.setVisible(bool(status.details))
        self.details.setVisible(bool(status.details) and self.more.isChecked())
        text = "\n".join(status.details)
        if self.details.toPlainText() != text:
            self.details.setPlainText(text)
        for button in (self.start, self.step):  # enabled during a pending start, as a disabled button loses the focus
            button.setEnabled(skills.can_start or skills.is_starting)
        if skills.form is None:
            return
        preview = skills.preview
        for hint in self._hints:
            colour_label(hint, "idle")
        for key, editor in self._editors.items():
            field = editor.field
            editor.show_recent(skills.recent_values(key))
            error = self._errors[key]
            # Errors of empty fields are named in the status only.
            error.setText(f"⚠ {field.error}")
            colour_label(error, "failure")
            error.setVisible(bool(field.error) and bool(field.text))
            if preview is not None and field.declared.is_element:
                found = preview.element(key) if field.mode is ValueMode.INFER else None
                editor.show_inferred(found, preview.choices.get(field.element_class, ()))

    def _label(self, field: Field) -> QLabel:
        suffix = " *" if field.declared.kind == "required" else ""
        label = PlainLabel(f"{field.key}{suffix}")
        label.setTextFormat(Qt.PlainText)
        of = f"{field.declared.kind}, {field.type_name}"
        label.setToolTip(plain_tip(f"{field.declared.description}\n{of}".strip()))
        return label

    def _field(self, field: Field) -> QWidget:
        editor = editor_of(field, self._skills)
        error = text_label("", is_selectable=False)
        error.hide()
        self._editors[field.key], self._errors[field.key] = editor, error
        holder = QWidget()
        column = QVBoxLayout(holder)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(1)
        column.addWidget(editor)
        column.addWidget(error)
        if field.hint:
            hint = text_label(f"hint_{field.key}", is_selectable=False)
            hint.setText(field.hint)
            self._hints.append(hint)
            column.addWidget(hint)
        return holder
