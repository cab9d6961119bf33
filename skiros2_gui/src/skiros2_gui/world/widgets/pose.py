"""The editor of an element's pose."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from python_qt_binding.QtCore import QSignalBlocker, Qt, QTimer
from python_qt_binding.QtGui import QWheelEvent
from python_qt_binding.QtWidgets import QDoubleSpinBox, QGridLayout, QLabel, QPushButton, QWidget

from skiros2_gui.world.details import PoseDetails

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
        self.frame = QLabel()
        self.frame.setTextFormat(Qt.PlainText)
        self.add = QPushButton("Add a pose")
        self.add.setObjectName("addPoseButton")
        self.add.setToolTip("Gives it a pose at the origin of its parent")
        self.add.clicked.connect(lambda: write([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]))
        self.remove = QPushButton("Remove the pose")
        self.remove.setObjectName("removePoseButton")
        self.remove.clicked.connect(lambda: remove())
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_WRITE_DELAY)
        self._timer.timeout.connect(self.flush)
        self.boxes = [_SpinBox(" m", 1e6, 0.01, 4) for _ in range(3)] + [_SpinBox("°", 360.0, 5.0, 3) for _ in range(3)]
        self._labels = [QLabel(name) for name in _NUMBERS]
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
            box.setToolTip(_ANGLE_TIPS[index - 3] if index >= 3 else "In the frame of its parent")
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
            self._shown = PoseDetails((*numbers[:3],), (*numbers[3:],), self._shown.frame)  # type: ignore[arg-type]
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
