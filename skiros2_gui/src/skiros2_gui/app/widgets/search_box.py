"""A combo box with a search."""

from __future__ import annotations

from python_qt_binding.QtCore import Qt, Signal
from python_qt_binding.QtGui import QKeyEvent, QWheelEvent
from python_qt_binding.QtWidgets import QComboBox, QCompleter, QWidget

from skiros2_common.core.names import local_name


class SearchBox(QComboBox):
    """An editable combo box whose entries are found by any part of their text.

    Typed text chooses the entry with that text, id (its data, also without prefix) or label (its text before two spaces
    and a bracket); text that names no entry is reset. The wheel scrolls what is around the box unless the box has the
    focus.
    """

    #: The user has chosen an entry; emits its row.
    chosen = Signal(int)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._row = -1
        self.setEditable(True)
        self.setInsertPolicy(QComboBox.NoInsert)
        self.setSizeAdjustPolicy(QComboBox.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(12)
        self.setMaxVisibleItems(20)
        completer: QCompleter = self.completer()
        completer.setFilterMode(Qt.MatchContains)
        completer.setCompletionMode(QCompleter.PopupCompletion)
        completer.setCaseSensitivity(Qt.CaseInsensitive)
        self.activated.connect(self._choose)
        self.lineEdit().editingFinished.connect(self._typed)

    @property
    def is_in_use(self) -> bool:
        """Whether the user is choosing, so that the entries must not change."""
        view = self.view()
        return bool(self.lineEdit().isModified() or (view is not None and view.isVisible()))

    @property
    def value(self) -> str:
        """The data of the shown entry; "" for none."""
        return str(self.itemData(self._row) or "") if self._row >= 0 else ""

    def show_value(self, value: str) -> None:
        """Shows the entry with that data, or none."""
        self.show_row(self.findData(value) if value else -1)

    def show_row(self, row: int) -> None:
        """Shows an entry; -1 for none."""
        self._row = row
        self.setCurrentIndex(row)
        if row < 0:
            self.lineEdit().clear()
        self.lineEdit().setModified(False)
        self.lineEdit().setCursorPosition(0)

    def wheelEvent(self, event: QWheelEvent) -> None:
        if self.hasFocus():
            super().wheelEvent(event)
        else:
            event.ignore()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        super().keyPressEvent(event)
        if event.key() in (Qt.Key_Return, Qt.Key_Enter):
            event.accept()  # it chooses an entry, and does not close a dialog

    def _choose(self, row: int) -> None:
        self.lineEdit().setModified(False)
        if row >= 0:
            self._row = row
            self.chosen.emit(row)

    def _typed(self) -> None:
        line = self.lineEdit()
        if not line.isModified():
            return
        text = line.text().strip().lower()
        rows = [row for row in range(self.count()) if text and text in self._names(row)]
        line.setModified(False)
        if len(rows) == 1:
            self.show_row(rows[0])
            self._choose(rows[0])
        else:
            self.show_row(self._row)

    def _names(self, row: int) -> tuple[str, ...]:
        text, data = self.itemText(row), str(self.itemData(row) or "")
        return text.lower(), data.lower(), local_name(data).lower(), text.rpartition("  (")[0].lower()
