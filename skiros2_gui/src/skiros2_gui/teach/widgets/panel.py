"""The page "Teach" of the tab "World model"."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDoubleSpinBox,
    QGridLayout,
    QGroupBox,
    QHBoxLayout,
    QLineEdit,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.wording import label_text
from skiros2_gui.app.widgets.controls import PlainLabel, plain_tip, push_button, text_label, timer
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.app.widgets.theme import colour_label
from skiros2_gui.teach.elements import PATH, POSE, Taught
from skiros2_gui.teach.presenter import Action, TeachPresenter
from skiros2_gui.teach.widgets.force_pad import PERIOD, ForcePad
from skiros2_gui.world.presenter import WorldPresenter

#: The periods of reading the scene, and of asking for the simulator (ms).
_READ_PERIOD, _SIMULATOR_PERIOD = 400, 3000

_TIPS = {
    Action.RELEASE: "Lets the arm be guided by hand, with its weight compensated",
    Action.TELEOPERATE: "The arm follows the twists of a hand-held device, on ROBOT/ARM/teleoperation",
    Action.HOLD: "The arm holds its pose; a path that is being recorded is stored",
    Action.RECORD_POSE: "Stores the pose of the tool, relative to the object",
    Action.RECORD_LIFTING: "Stores the pose of the tool as the lifting pose of the chosen pose",
    Action.RECORD_PATH: "Records the path of the tool, and the commands to the gripper, until it is stored",
    Action.STORE_PATH: "Stores the recorded path; the arm stays released",
    Action.MOVE_TO_POSE: "Moves the tool to the chosen pose, relative to the object as it is now",
    Action.REPLAY_PATH: "Moves the tool along the chosen path, relative to the object as it is now",
    Action.MOVE_GRIPPER: "Moves the fingers to this distance",
    Action.RENAME: "Renames the chosen pose or path",
    Action.DELETE: "Deletes the chosen pose or path; Undo restores it",
}


class TeachPanel(QWidget):
    """Reads the scene only while it is visible."""

    def __init__(self, world: WorldPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.presenter = TeachPresenter(world, self._show_soon)
        self._buttons: dict[Action, QPushButton] = {}
        self._arm = QComboBox()
        self._arm.setObjectName("teachArm")
        self._arm.activated.connect(lambda _: self.presenter.choose_arm(self._arm.currentData()))
        self._owner = text_label("teachOwner")
        self._name = QLineEdit()
        self._name.setObjectName("teachName")
        self._name.setPlaceholderText("name of the next pose or path")
        self._name.textChanged.connect(self._set_name)
        self._list = RowsView(RowsModel(("Name", "Taught"), 0, self._rename), 1)
        self._list.setObjectName("taughtList")
        self._list.setSelectionMode(QAbstractItemView.SingleSelection)
        self._list.selectionModel().currentChanged.connect(lambda index, _: self._choose(index.row()))
        self._status = text_label("teachStatus")
        self._width = QDoubleSpinBox()
        self._width.setObjectName("gripperWidth")
        self._width.setRange(0.0, 500.0)
        self._width.setDecimals(0)
        self._width.setSuffix(" mm")
        self._width.setValue(80.0)
        self._pad = ForcePad()
        self._pad.pushed.connect(lambda x, y, z: self.presenter.push((x, y, z), PERIOD / 1000.0))
        self._limit = QDoubleSpinBox()
        self._limit.setObjectName("forceLimit")
        self._limit.setRange(1.0, 60.0)
        self._limit.setDecimals(0)
        self._limit.setSuffix(" N")
        self._limit.setValue(self._pad.maximum)
        self._limit.valueChanged.connect(lambda value: setattr(self._pad, "maximum", value))
        self._lay_out()
        self._show_timer = timer(self, 0, self.show_all)
        self._read_timer = timer(self, _READ_PERIOD, self.show_all, repeats=True)
        self._simulator_timer = timer(self, _SIMULATOR_PERIOD, self.presenter.ask_simulator, repeats=True)

    def close_timers(self) -> None:
        """Stops reading."""
        for one in (self._show_timer, self._read_timer, self._simulator_timer):
            one.stop()

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        self.presenter.ask_simulator()
        self.show_all()
        self._read_timer.start()
        self._simulator_timer.start()

    def hideEvent(self, event: Any) -> None:
        super().hideEvent(event)
        self.close_timers()

    # -- showing -----------------------------------------------------------------------------------------------------

    def _show_soon(self) -> None:
        if self.isVisible():
            self._show_timer.start()

    def show_all(self) -> None:
        """Reads the scene and shows everything."""
        presenter = self.presenter
        presenter.refresh()
        known = [(arm.eid, f"{label_text(arm.label)} of {label_text(arm.robot)}") for arm in presenter.arms]
        if known != [(self._arm.itemData(n), self._arm.itemText(n)) for n in range(self._arm.count())]:
            self._arm.clear()
            for eid, text in known:
                self._arm.addItem(text, eid)
        if presenter.arm is not None:
            self._arm.setCurrentIndex(self._arm.findData(presenter.arm.eid))
        owner = presenter.owner
        name = label_text(owner.label) or owner.id if owner is not None else ""
        self._owner.setText(f"Taught of {name}" if name else "No object is selected")
        self._show_taught()
        self._status.setText(presenter.status)
        colour_label(self._status, "failure" if presenter.has_failed else "")
        self._show_buttons()
        self._pad.setEnabled(not presenter.push_problem and presenter.arm is not None)
        tip = "Drag: a force at the tool, seen from above (x up, y left); with Shift along z"
        self._pad.setToolTip(plain_tip(presenter.push_problem or tip))

    def _show_taught(self) -> None:
        presenter = self.presenter
        model = self._list.selectionModel()
        model.blockSignals(True)
        self._list.rows.show_rows([Row((t.name, t.text), t.eid, t) for t in presenter.taught])
        number = next((n for n, t in enumerate(presenter.taught) if t == presenter.chosen), -1)
        if number < 0:
            self._list.clearSelection()
        elif not model.isRowSelected(number, self._list.rootIndex()):
            self._list.selectRow(number)
        model.blockSignals(False)
        self._list.viewport().update()

    def _show_buttons(self) -> None:
        presenter = self.presenter
        same = presenter.same_name()
        for action, kind, what in ((Action.RECORD_POSE, POSE, "pose"), (Action.RECORD_PATH, PATH, "path")):
            is_there = same is not None and same.kind == kind
            self._buttons[action].setText(f"{'Replace' if is_there else 'Record'} {what}")
        is_path = presenter.chosen is not None and presenter.chosen.kind == PATH
        self._buttons[Action.MOVE_TO_POSE].setVisible(not is_path)
        self._buttons[Action.REPLAY_PATH].setVisible(is_path)
        for action, button in self._buttons.items():
            obstacle = presenter.obstacle(action)
            button.setEnabled(not obstacle)
            button.setToolTip(plain_tip(obstacle or _TIPS[action]))

    # -- what the user does ------------------------------------------------------------------------------------------

    def _set_name(self, name: str) -> None:
        self.presenter.name = name.strip()
        self._show_buttons()

    def _choose(self, row: int) -> None:
        rows = self._list.rows.rows
        taught: Taught | None = rows[row].item if 0 <= row < len(rows) else None
        self.presenter.choose(taught.eid if taught is not None else "")

    def _edit_name(self) -> None:
        number = next((n for n, t in enumerate(self.presenter.taught) if t == self.presenter.chosen), -1)
        if number >= 0:
            self._list.edit(self._list.rows.index(number, 0))

    def _rename(self, taught: Taught, name: str) -> None:
        self.presenter.rename(taught, name)

    # -- widgets -----------------------------------------------------------------------------------------------------

    def _button(self, action: Action, text: str, call: Callable[[], Any] | None = None) -> QPushButton:
        do = call if call is not None else (lambda: self.presenter.do(action))
        self._buttons[action] = push_button(text, f"teach_{action.name.lower()}", do)
        return self._buttons[action]

    def _lay_out(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        row = QHBoxLayout()
        row.addWidget(PlainLabel("Arm"))
        row.addWidget(self._arm, 1)
        row.addWidget(self._button(Action.RELEASE, "Release arm"))
        row.addWidget(self._button(Action.TELEOPERATE, "Teleoperate"))
        row.addWidget(self._button(Action.HOLD, "Hold arm"))
        column.addLayout(row)
        column.addWidget(self._status)
        column.addWidget(self._owner)
        column.addWidget(self._list, 1)
        row = QHBoxLayout()
        row.addWidget(self._button(Action.MOVE_TO_POSE, "Move there"))
        row.addWidget(self._button(Action.REPLAY_PATH, "Replay"))
        row.addWidget(self._button(Action.RECORD_LIFTING, "Record lifting pose"))
        row.addWidget(self._button(Action.RENAME, "Rename", self._edit_name))
        row.addWidget(self._button(Action.DELETE, "Delete", self.presenter.delete))
        row.addStretch(1)
        column.addLayout(row)
        recording = QGroupBox("Record")
        grid = QGridLayout(recording)
        grid.addWidget(self._name, 0, 0, 1, 3)
        grid.addWidget(self._button(Action.RECORD_POSE, "Record pose"), 1, 0)
        grid.addWidget(self._button(Action.RECORD_PATH, "Record path"), 1, 1)
        grid.addWidget(self._button(Action.STORE_PATH, "Store path"), 1, 2)
        grid.addWidget(PlainLabel("Gripper"), 2, 0, Qt.AlignRight)
        grid.addWidget(self._width, 2, 1)
        move = self._button(
            Action.MOVE_GRIPPER,
            "Move gripper",
            lambda: self.presenter.do(Action.MOVE_GRIPPER, Width=self._width.value() / 1000.0),
        )
        grid.addWidget(move, 2, 2)
        pushing = QGroupBox("Force in the simulator")
        inner = QVBoxLayout(pushing)
        inner.addWidget(self._pad, 1, Qt.AlignCenter)
        inner.addWidget(self._limit)
        row = QHBoxLayout()
        row.addWidget(recording, 1)
        row.addWidget(pushing)
        column.addLayout(row)
