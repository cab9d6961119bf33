"""The panel of the selected element: label, pose, properties, relations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from python_qt_binding.QtCore import QEvent, QSignalBlocker, Qt
from python_qt_binding.QtGui import QKeySequence, QWheelEvent
from python_qt_binding.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QGridLayout,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QShortcut,
    QSplitter,
    QStyledItemDelegate,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_common.core.wording import short_name
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, timer
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.world.details import Details, PoseDetails, PropertyRow, RelationRow
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.widgets.dialogs import PropertyDialog, RelationDialog, ValuesDialog
from skiros2_world_model.core.formatting import format_time

_NUMBERS = ("x", "y", "z", "Roll", "Pitch", "Yaw")
_ANGLE_TIPS = ("The rotation about x", "The rotation about y, after roll", "The rotation about z, after roll and pitch")

#: The delay that combines several steps of a number into one change (ms).
_WRITE_DELAY = 300

_IDENTITY = PoseDetails((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "")


class PoseEditor(QWidget):
    """Six numbers, written when they have been edited. A pose being edited is not updated.

    :param write: called with position (m) and angles (degrees), three numbers each.
    :param remove: called to remove the pose.
    """

    def __init__(self, write: Callable[[list[float], list[float]], None], remove: Callable[[], None]) -> None:
        super().__init__()
        self._write = write
        self._shown = _IDENTITY
        self.frame = PlainLabel()
        self.frame.setTextFormat(Qt.PlainText)
        self.add = push_button(
            "Add a pose",
            "addPoseButton",
            lambda: write([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
            "Gives it a pose at the origin of its parent",
        )
        self.remove = push_button("Remove the pose", "removePoseButton", lambda: remove())
        self._timer = timer(self, _WRITE_DELAY, self.flush)
        self.boxes = [_SpinBox(" m", 1e6, 0.01, 4) for _ in range(3)] + [_SpinBox("°", 360.0, 5.0, 3) for _ in range(3)]
        self._labels = [PlainLabel(name) for name in _NUMBERS]
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.addWidget(self.frame, 0, 0, 1, 5)
        grid.addWidget(self.add, 0, 5, 1, 2, Qt.AlignRight)
        grid.addWidget(self.remove, 0, 5, 1, 2, Qt.AlignRight)
        for index, (label, box) in enumerate(zip(self._labels, self.boxes, strict=True)):
            row, column = 1 + index // 3, 2 * (index % 3)
            label.setAlignment(Qt.AlignRight | Qt.AlignVCenter)
            grid.addWidget(label, row, column)
            grid.addWidget(box, row, column + 1, 1, 2 if column == 4 else 1)
            grid.setColumnStretch(column + 1, 1)
            box.setObjectName(f"pose{_NUMBERS[index]}")
            box.setToolTip(plain_tip(_ANGLE_TIPS[index - 3] if index >= 3 else "In the frame of its parent"))
            box.valueChanged.connect(lambda _: self._timer.start())
            box.editingFinished.connect(self.flush)

    def show_pose(self, pose: PoseDetails | None) -> None:
        """Shows a pose; None: the element has none."""
        if self._timer.isActive() or any(box.is_edited for box in self.boxes):
            return
        self._shown = pose or _IDENTITY
        self.frame.setText(f"Pose in {pose.frame}" if pose and pose.frame else "Pose" if pose else "No pose")
        self.add.setVisible(pose is None)
        self.remove.setVisible(pose is not None)
        for label, box, number in zip(self._labels, self.boxes, self._numbers, strict=True):
            label.setVisible(pose is not None)
            box.setVisible(pose is not None)
            with QSignalBlocker(box):
                box.setValue(number)

    def flush(self) -> None:
        """Writes numbers that were edited and have not been written."""
        self._timer.stop()
        pairs = zip(self.boxes, self._numbers, strict=True)
        # Unchanged numbers are not rounded.
        numbers = [old if box.value() == round(old, box.decimals()) else box.value() for box, old in pairs]
        if numbers != self._numbers:
            x, y, z, roll, pitch, yaw = numbers
            self._shown = PoseDetails((x, y, z), (roll, pitch, yaw), self._shown.frame)
            self._write(numbers[:3], numbers[3:])

    @property
    def _numbers(self) -> Sequence[float]:
        return [*self._shown.position, *self._shown.angles]


class _SpinBox(QDoubleSpinBox):
    """The wheel scrolls what is around the box unless it has the focus."""

    def __init__(self, unit: str, most: float, step: float, decimals: int) -> None:
        super().__init__()
        self.setDecimals(decimals)
        self.setRange(-most, most)
        self.setSingleStep(step)
        self.setSuffix(unit)
        self.setAccelerated(True)
        self.setKeyboardTracking(False)
        self.setFocusPolicy(Qt.StrongFocus)

    @property
    def is_edited(self) -> bool:
        """Whether the user is typing a number."""
        return bool(self.hasFocus() and self.lineEdit().isModified())

    def textFromValue(self, value: float) -> str:
        text = super().textFromValue(value)
        point = self.locale().decimalPoint()
        return text.rstrip("0").rstrip(point) if point in text else text

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self.hasFocus():
            super().wheelEvent(event)
        else:
            event.ignore()


_VALUE = 1


class ElementPanel(QWidget):
    """Shows and edits the presenter's selected element."""

    def __init__(self, presenter: WorldPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._shown: Details | None = None
        self.heading = PlainLabel()
        self.heading.setMinimumWidth(1)  # a long name does not widen the window
        self.heading.setTextInteractionFlags(Qt.TextSelectableByMouse)
        self._set_fonts()
        self.about = PlainLabel()
        self.about.setWordWrap(True)
        self.about.setTextInteractionFlags(Qt.TextSelectableByMouse)
        self.label_edit = QLineEdit()
        self.label_edit.setObjectName("elementLabel")
        self.label_edit.setPlaceholderText("no label")
        self.label_edit.setToolTip("The label: the template it was made from, or a free name. Enter writes it")
        self.label_edit.editingFinished.connect(self._write_label)
        self.pose = PoseEditor(self._write_pose, self._remove_pose)
        self.properties = RowsView(
            RowsModel(("Property", "Value", "Unit"), _VALUE, self._write_value, lambda row: _in_place(row)), _VALUE
        )
        self.properties.setObjectName("elementTable")
        self.properties.setItemDelegateForColumn(_VALUE, _ValueDelegate(self.properties))
        self.properties.doubleClicked.connect(self._edit_whole)
        self.relations = RowsView(RowsModel(("Relation", "", "Element")), 2)
        self.relations.setObjectName("relationTable")
        self.relations.doubleClicked.connect(lambda _: self.follow_relation())
        self.relations.setToolTip("Enter or a double click goes to the element")
        self._lay_out()
        for view, key, call in (
            (self.properties, Qt.Key_Delete, self.remove_property),
            (self.relations, Qt.Key_Delete, self.remove_relation),
            (self.relations, Qt.Key_Return, self.follow_relation),
            (self.relations, Qt.Key_Enter, self.follow_relation),
        ):
            QShortcut(QKeySequence(key), view, call, context=Qt.WidgetShortcut)
        self.show_details()

    def _lay_out(self) -> None:
        self.add_property_button = push_button(
            "Add property…", "addPropertyButton", self.add_property, "Adds a property"
        )
        self.remove_property_button = push_button(
            "Remove property", "removePropertyButton", self.remove_property, "Removes the selected property (Delete)"
        )
        self.add_relation_button = push_button(
            "Add relation…", "addRelationButton", self.add_relation, "Adds a relation to another element"
        )
        self.remove_relation_button = push_button(
            "Remove relation", "removeRelationButton", self.remove_relation, "Removes the selected relation (Delete)"
        )
        top = QVBoxLayout()
        top.addWidget(self.heading)
        top.addWidget(self.about)
        row = QHBoxLayout()
        row.addWidget(PlainLabel("Label"))
        row.addWidget(self.label_edit, 1)
        top.addLayout(row)
        top.addWidget(self.pose)
        splitter = QSplitter(Qt.Vertical)
        splitter.addWidget(_with_buttons(self.properties, self.add_property_button, self.remove_property_button))
        splitter.addWidget(_with_buttons(self.relations, self.add_relation_button, self.remove_relation_button))
        splitter.setStretchFactor(0, 5)
        splitter.setStretchFactor(1, 2)
        splitter.setSizes([500, 200])
        splitter.setChildrenCollapsible(False)
        column = QVBoxLayout(self)
        column.addLayout(top)
        column.addWidget(splitter, 1)

    def changeEvent(self, event: Any) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._set_fonts()

    def _set_fonts(self) -> None:
        font = self.font()
        font.setPointSizeF(font.pointSizeF() * 1.25)
        font.setBold(True)
        self.heading.setFont(font)

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        self.show_details()

    # -- showing -----------------------------------------------------------------------------------------------

    def show_details(self) -> None:
        """Updates the panel while it is visible. A label being edited is kept."""
        if not self.isVisible():
            return  # see `showEvent`
        details = self._presenter.details()
        before = self._shown
        is_different = before is None or details is None or before.id != details.id
        if is_different:
            self.pose.flush()
        self._shown = details
        for widget in (
            self.label_edit,
            self.properties,
            self.relations,
            self.pose,
            self.add_property_button,
            self.remove_property_button,
            self.add_relation_button,
            self.remove_relation_button,
        ):
            widget.setEnabled(details is not None)
        if details is None:
            self.heading.setText("No element is selected")
            self.about.setText("Select one in the tree on the left.")
            self.label_edit.clear()
            self.properties.rows.show_rows(())
            self.relations.rows.show_rows(())
            self.pose.hide()
            return
        self.heading.setText(short_name(local_name(details.label) or local_name(details.id)))
        self.about.setText(_about(details, self._presenter.author()))
        self.about.setToolTip(plain_tip(details.type_description))
        if is_different or not self.label_edit.isModified():  # not while it is being edited
            self.label_edit.setText(details.label)
        self.pose.show()
        self.pose.show_pose(details.pose)
        if is_different:  # reset the selection
            self.properties.rows.show_rows(())
            self.relations.rows.show_rows(())
        self.properties.rows.show_rows([_property_cells(row) for row in details.properties])
        self.relations.rows.show_rows([_relation_cells(row) for row in details.relations])

    # -- changing ----------------------------------------------------------------------------------------------

    def _write_label(self) -> None:
        details, label = self._shown, self.label_edit.text().strip()
        if not self.label_edit.isModified():
            return
        self.label_edit.setModified(False)
        if details is not None and label != details.label:
            name = local_name(details.id)
            self._presenter.change(f"label of {name}", lambda r: r.set_label(details.id, label))

    def _write_pose(self, position: list[float], angles: list[float]) -> None:
        details = self._shown
        if details is not None:
            what = f"pose of {local_name(details.id)}"
            self._presenter.change(what, lambda r: r.set_pose(details.id, position, angles))

    def _remove_pose(self) -> None:
        details = self._shown
        if details is not None:
            self._presenter.change(f"remove pose of {local_name(details.id)}", lambda r: r.remove_pose(details.id))

    def _write_value(self, row: PropertyRow, text: str) -> None:
        self._write_values(row.key, [text] if text or row.kind is str else [])

    def _write_values(self, key: str, texts: list[str]) -> None:
        details = self._shown
        if details is None:
            return
        what = f"{local_name(key)} of {local_name(details.id)}"
        self._presenter.change(what, lambda r: r.set_values(details.id, key, texts))

    def _edit_whole(self, index: Any) -> None:
        row = self.properties.rows.rows[index.row()].item
        if index.column() == _VALUE and not _in_place(row):
            dialog = ValuesDialog(row, self)
            dialog.setAttribute(Qt.WA_DeleteOnClose)
            dialog.chosen.connect(lambda texts: self._write_values(row.key, texts))
            dialog.open()

    def add_property(self) -> None:
        """Opens the property dialog."""
        vocabulary, details = self._presenter.vocabulary, self._shown
        if vocabulary is not None and details is not None:
            dialog = PropertyDialog(vocabulary, details, self)
            dialog.setAttribute(Qt.WA_DeleteOnClose)
            dialog.chosen.connect(self._write_values)
            dialog.open()

    def remove_property(self) -> None:
        """Removes the selected properties."""
        details, rows = self._shown, self.properties.chosen()
        if details is not None and rows:
            what = f"remove {', '.join(row.name for row in rows)} of {local_name(details.id)}"
            self._presenter.change(what, lambda r: [o for row in rows for o in r.remove_property(details.id, row.key)])

    def add_relation(self) -> None:
        """Opens the relation dialog."""
        if self._shown is not None and self._presenter.hierarchy is not None:
            dialog = RelationDialog(self._presenter, self._shown.id, self)
            dialog.setAttribute(Qt.WA_DeleteOnClose)
            dialog.open()

    def remove_relation(self) -> None:
        """Removes the selected relations."""
        details, rows = self._shown, self.relations.chosen()
        if details is None or not rows:
            return
        ends = [(details.id, r.predicate, r.other) if r.outgoing else (r.other, r.predicate, details.id) for r in rows]
        what = f"remove {', '.join(row.name for row in rows)} of {local_name(details.id)}"
        self._presenter.change(what, lambda r: [o for relation in ends for o in r.unrelate(*relation)])

    def follow_relation(self) -> None:
        """Selects the element of the selected relation."""
        rows = [row for row in self.relations.chosen() if row.is_element]
        if rows:
            self._presenter.select(rows[0].other)


class _ValueDelegate(QStyledItemDelegate):
    """The editor of a value: a combo box for booleans, else a line edit."""

    def createEditor(self, parent: QWidget, option: Any, index: Any) -> QWidget:
        row = index.model().rows[index.row()].item
        if row.kind is bool:
            box = QComboBox(parent)
            box.addItems(("True", "False"))
            return box
        line = QLineEdit(parent)
        line.setFrame(False)
        line.setPlaceholderText(f"{row.kind_text}{f' in {row.unit}' if row.unit else ''}")
        return line

    def setEditorData(self, editor: QWidget, index: Any) -> None:
        row = index.model().rows[index.row()].item
        text = row.texts[0] if row.values else ""
        if isinstance(editor, QComboBox):
            editor.setCurrentText(text)
        else:
            editor.setText(text)

    def setModelData(self, editor: QWidget, model: Any, index: Any) -> None:
        text = editor.currentText() if isinstance(editor, QComboBox) else editor.text()
        row = model.rows[index.row()].item
        if text != (row.texts[0] if row.values else ""):
            model.setData(index, text)


def _in_place(row: PropertyRow) -> bool:
    """Returns whether a value can be edited in the table."""
    is_one_line = all("\n" not in value for value in row.values if isinstance(value, str))
    return row.is_plain and len(row.values) <= 1 and is_one_line


def _property_cells(row: PropertyRow) -> Row:
    text = row.text if row.is_plain else ", ".join(row.texts)
    lines = [row.key, row.description, f"Type: {row.kind_text}"]
    if not _in_place(row):
        lines.append("Double-click to edit")
    shown = " ".join(text.split())
    return Row((row.name, shown, row.unit), "\n".join(line for line in lines if line), row)


def _relation_cells(row: RelationRow) -> Row:
    direction = "to" if row.outgoing else "from"
    lines = [row.predicate, row.description, row.other if row.is_element else f"{row.other}, a template"]
    return Row((row.name, direction, row.other_text), "\n".join(line for line in lines if line), row)


def _about(details: Details, own: str) -> str:
    words = f"{details.id}  ·  {details.type}"
    if details.author:
        who = "this window" if details.author == own else details.author.strip("/")
        words += f"  ·  last changed by {who}, {format_time(details.stamp)}"
    return words


def _with_buttons(view: QWidget, *buttons: QPushButton) -> QWidget:
    box = QWidget()
    column = QVBoxLayout(box)
    column.setContentsMargins(0, 0, 0, 0)
    column.addWidget(view, 1)
    row = QHBoxLayout()
    for button in buttons:
        row.addWidget(button)
    row.addStretch(1)
    column.addLayout(row)
    return box
