"""The panel of breakpoints."""

from __future__ import annotations

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.run.breakpoints import CHOICES
from skiros2_gui.run.presenter import RunPresenter

_HINTS = {
    "node": "label or type of a node; * matches any text",
    "condition": "label of a condition; * matches any text",
    "world": "id or label of an element, or a relation",
}


class BreakpointPanel(QWidget):
    """Lists, adds and removes breakpoints of the shown task's robot."""

    def __init__(self, presenter: RunPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._robot = ""
        self._title = QLabel()
        self._title.setWordWrap(True)
        self._list = QListWidget()
        self._list.setObjectName("breakpoints")
        self._list.currentItemChanged.connect(lambda *_: self._enable())
        self._when = QComboBox()
        self._when.setObjectName("breakpointKind")
        for text, kind, when in CHOICES:
            self._when.addItem(f"Pause {text}", (kind, when))
        self._when.currentIndexChanged.connect(lambda _: self._hint())
        self._pattern = QLineEdit()
        self._pattern.setObjectName("breakpointPattern")
        self._pattern.setClearButtonEnabled(True)
        self._pattern.returnPressed.connect(self._add)
        self._pattern.textChanged.connect(lambda _: self._enable())
        self._add_button = QPushButton("Add")
        self._add_button.setObjectName("breakpointAdd")
        self._add_button.clicked.connect(self._add)
        self._remove_button = QPushButton("Remove")
        self._remove_button.setObjectName("breakpointRemove")
        self._remove_button.clicked.connect(self._remove)
        row = QHBoxLayout()
        row.addWidget(self._pattern, 1)
        row.addWidget(self._add_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addWidget(self._title)
        column.addWidget(self._list, 1)
        column.addWidget(self._remove_button, 0, Qt.AlignRight)
        column.addWidget(self._when)
        column.addLayout(row)
        self._hint()
        self.show_breakpoints()

    def show_breakpoints(self) -> None:
        """Shows the breakpoints of the presenter's robot."""
        self._robot = self._presenter.robot
        robot = self._robot
        self._title.setText(
            f"Tasks of {robot.lstrip('/')} pause:" if robot else "No robot is running."
        )
        known = list(self._presenter.breakpoints.of(robot))
        chosen = self._list.currentRow()
        self._list.clear()
        for one in known:
            item = QListWidgetItem(str(one))
            item.setData(Qt.UserRole, one)
            item.setToolTip(f"breakpoint {one.number} of {one.robot}")
            self._list.addItem(item)
        self._list.setCurrentRow(min(chosen, len(known) - 1))
        self._enable()

    def _hint(self) -> None:
        kind, _ = self._when.currentData()
        self._pattern.setPlaceholderText(_HINTS.get(kind, ""))
        self._pattern.setToolTip(_HINTS.get(kind, ""))

    def _add(self) -> None:
        text = self._pattern.text().strip()
        if text and self._robot:
            kind, when = self._when.currentData()
            self._presenter.breakpoints.add(self._robot, kind, text, when)
            self._pattern.clear()

    def _remove(self) -> None:
        item = self._list.currentItem()
        if item is not None:
            self._presenter.breakpoints.remove(item.data(Qt.UserRole))

    def _enable(self) -> None:
        self._add_button.setEnabled(bool(self._robot and self._pattern.text().strip()))
        self._remove_button.setEnabled(self._list.currentItem() is not None)
