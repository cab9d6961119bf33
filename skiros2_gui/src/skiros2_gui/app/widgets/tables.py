"""Tables that keep their selection while their rows are updated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from python_qt_binding.QtCore import QAbstractTableModel, QEvent, QModelIndex, Qt
from python_qt_binding.QtGui import QFont, QFontDatabase, QGuiApplication, QKeySequence
from python_qt_binding.QtWidgets import QAbstractItemView, QHeaderView, QShortcut, QTableView, QWidget

from skiros2_gui.app.widgets import theme

#: The parent of all rows.
_NOWHERE = QModelIndex()


@dataclass(frozen=True)
class Row:
    """A row of a table.

    :param cells: texts.
    :param tip: the tooltip of all cells.
    :param item: any object, such as the row's data.
    :param colour: the colour role of the texts; "" for the default.
    :param coloured: the coloured column; -1 for all.
    """

    cells: tuple[str, ...]
    tip: str = ""
    item: Any = None
    colour: str = ""
    coloured: int = -1


class RowsModel(QAbstractTableModel):
    """A table model of texts.

    :param write: called with a row's item and the new text of its `editable` column; None makes the table read-only.
    """

    def __init__(
        self,
        headers: Sequence[str],
        editable: int = -1,
        write: Callable[[Any, str], None] | None = None,
        can_write: Callable[[Any], bool] | None = None,
    ) -> None:
        super().__init__()
        self.headers = tuple(headers)
        self.rows: tuple[Row, ...] = ()
        self._editable = editable
        self._write = write
        self._can_write = can_write

    def show_rows(self, rows: Sequence[Row], headers: Sequence[str] | None = None) -> None:
        """Replaces the rows. The selection is kept if the first column is unchanged, or rows were appended only."""
        rows, headers = tuple(rows), self.headers if headers is None else tuple(headers)
        known = len(self.rows)
        if headers == self.headers and 0 < known < len(rows) and rows[:known] == self.rows:
            self.beginInsertRows(_NOWHERE, known, len(rows) - 1)
            self.rows = rows
            self.endInsertRows()
            return
        if headers != self.headers or [r.cells[:1] for r in rows] != [r.cells[:1] for r in self.rows]:
            self.beginResetModel()
            self.rows, self.headers = rows, headers
            self.endResetModel()
            return
        before, self.rows = self.rows, rows
        for i, (was, now) in enumerate(zip(before, rows, strict=True)):
            if was != now:
                self.dataChanged.emit(self.index(i, 0), self.index(i, len(self.headers) - 1))

    def rowCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return 0 if parent.isValid() else len(self.headers)

    def headerData(self, section: int, orientation: int, role: int = Qt.DisplayRole) -> Any:
        if role == Qt.DisplayRole and orientation == Qt.Horizontal and section < len(self.headers):
            return self.headers[section]
        if role == Qt.TextAlignmentRole and orientation == Qt.Horizontal:
            return int(Qt.AlignLeft | Qt.AlignVCenter)
        return None

    def data(self, index: QModelIndex, role: int = Qt.DisplayRole) -> Any:
        row = self.rows[index.row()]
        if role in (Qt.DisplayRole, Qt.EditRole):
            return row.cells[index.column()] if index.column() < len(row.cells) else ""
        if role == Qt.ToolTipRole:
            return row.tip or None
        if role == Qt.ForegroundRole and row.colour and row.coloured in (-1, index.column()):
            return theme.role_colour(row.colour)
        return None

    def setData(self, index: QModelIndex, value: Any, role: int = Qt.EditRole) -> bool:
        if role == Qt.EditRole and self._write is not None and str(value) != self.data(index):
            self._write(self.rows[index.row()].item, str(value))
        return False  # shown when the world model has changed

    def flags(self, index: QModelIndex) -> Any:
        flags = super().flags(index)
        item = self.rows[index.row()].item
        if index.column() == self._editable and (self._can_write is None or self._can_write(item)):
            flags |= Qt.ItemIsEditable
        return flags


class RowsView(QTableView):
    """A table with row selection; Ctrl+C copies the selection.

    :param stretched: the column that takes the free width; -1: the last one.
    :param wraps: whether rows are as high as their texts need; otherwise long texts are cut off.
    """

    def __init__(
        self, model: RowsModel, stretched: int = -1, parent: QWidget | None = None, wraps: bool = False
    ) -> None:
        super().__init__(parent)
        self.setModel(model)
        self.rows = model
        self.setSelectionBehavior(QAbstractItemView.SelectRows)
        self.setAlternatingRowColors(True)
        self.setShowGrid(False)
        self.setWordWrap(wraps)
        self.setTextElideMode(Qt.ElideRight)
        self.verticalHeader().hide()
        self._set_height()
        header = self.horizontalHeader()
        header.setHighlightSections(False)
        if wraps:
            self.setVerticalScrollMode(QAbstractItemView.ScrollPerPixel)
            self.verticalHeader().setSectionResizeMode(QHeaderView.ResizeToContents)
        if stretched >= 0:
            header.setResizeContentsPrecision(0)  # visible rows only
            header.setSectionResizeMode(QHeaderView.ResizeToContents)
            header.setSectionResizeMode(stretched, QHeaderView.Stretch)
        else:
            header.setStretchLastSection(True)
        QShortcut(QKeySequence(QKeySequence.Copy), self, self.copy, context=Qt.WidgetShortcut)

    def changeEvent(self, event: Any) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._set_height()

    def _set_height(self) -> None:
        self.verticalHeader().setMinimumSectionSize(1)
        self.verticalHeader().setDefaultSectionSize(int(self.fontMetrics().height() * 1.35))

    def chosen(self) -> list[Any]:
        """Returns the items of the selected rows."""
        return [self.rows.rows[index.row()].item for index in self.selectionModel().selectedRows()]

    def copy(self) -> None:
        """Copies the selected rows to the clipboard, cells separated by tabs."""
        rows = sorted(index.row() for index in self.selectionModel().selectedRows())
        QGuiApplication.clipboard().setText("\n".join("\t".join(self.rows.rows[row].cells) for row in rows))


def fixed_font() -> QFont:
    """Returns a fixed-width font with the default size."""
    font = QFont()
    font.setFamily(QFontDatabase.systemFont(QFontDatabase.FixedFont).family())
    return font
