"""The tree of the scene, its Qt model, and the search above it."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from python_qt_binding.QtCore import QAbstractItemModel, QEvent, QMimeData, QModelIndex, Qt, Signal
from python_qt_binding.QtGui import QColor, QFont
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QLineEdit,
    QTreeView,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_gui.app.widgets import theme
from skiros2_gui.app.widgets.controls import PlainLabel, timer
from skiros2_gui.world.details import display_name
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.scene import TOP, UNPLACED
from skiros2_world_model.core.scene import ROOT

HEADERS = ("Element", "Class", "Changed by")
#: The parent of top-level rows.
_NOWHERE = QModelIndex()
#: The supported roles.
_ROLES = frozenset(
    (Qt.DisplayRole, Qt.AccessibleTextRole, Qt.ToolTipRole, Qt.ForegroundRole, Qt.BackgroundRole, Qt.FontRole)
)
_MIME = "application/x-skiros-elements"


class SceneModel(QAbstractItemModel):
    """Adapts the presenter's tree; stores a number for each element that a view has requested."""

    #: Emits the ids of dropped elements, and the id of the target.
    dropped = Signal(list, str)
    #: Decorations have changed.
    redrawn = Signal()

    def __init__(self, presenter: WorldPresenter) -> None:
        super().__init__()
        self._presenter = presenter
        self._numbers: dict[str, int] = {}
        self._ids: list[str] = []
        self._found: frozenset[str] = frozenset()

    # -- presenter's view --------------------------------------------------------------------------------------

    def show_scene(self) -> None:
        """Resets the model to the presenter's scene."""
        self.beginResetModel()
        self._numbers.clear()
        self._ids.clear()
        if self._presenter.hierarchy is not None:
            self._presenter.hierarchy.view = self
        self.endResetModel()

    def begin_layout(self) -> None:
        self.layoutAboutToBeChanged.emit()

    def end_layout(self) -> None:
        before = self.persistentIndexList()
        after = [self.index_of(self.element(index)).siblingAtColumn(index.column()) for index in before]
        self.changePersistentIndexList(before, after)
        self.layoutChanged.emit()

    def elements_changed(self, ids: Iterable[str]) -> None:
        for eid in ids:
            index = self.index_of(eid) if eid in self._numbers else QModelIndex()
            if index.isValid():
                self.dataChanged.emit(index, index.siblingAtColumn(len(HEADERS) - 1))

    def show_found(self, ids: Iterable[str]) -> None:
        """Shows elements in bold."""
        self._found = frozenset(ids)
        self.redrawn.emit()

    # -- elements and indexes ----------------------------------------------------------------------------------

    def index_of(self, eid: str) -> QModelIndex:
        """Returns the index of an element; invalid if it is not in the tree."""
        hierarchy = self._presenter.hierarchy
        if hierarchy is None or eid == TOP or not hierarchy.is_shown(eid):
            return QModelIndex()
        row = hierarchy.row(eid)
        return self.createIndex(row, 0, self._number(eid)) if row >= 0 else QModelIndex()

    def element(self, index: QModelIndex) -> str:
        """Returns the element of an index; `TOP` for an invalid one."""
        return self._ids[index.internalId()] if index.isValid() else TOP

    def _number(self, eid: str) -> int:
        number = self._numbers.get(eid)
        if number is None:
            number = self._numbers[eid] = len(self._ids)
            self._ids.append(eid)
        return number

    # -- Qt's interface ------------------------------------------------------------------------------------------

    def index(self, row: int, column: int, parent: QModelIndex = _NOWHERE) -> QModelIndex:
        hierarchy = self._presenter.hierarchy
        above = self.element(parent)
        if hierarchy is None or not 0 <= row < len(hierarchy.children(above)) or not 0 <= column < len(HEADERS):
            return QModelIndex()
        return self.createIndex(row, column, self._number(hierarchy.children(above)[row]))

    def parent(self, index: QModelIndex) -> QModelIndex:
        hierarchy = self._presenter.hierarchy
        if hierarchy is None or not index.isValid():
            return QModelIndex()
        return self.index_of(hierarchy.parent(self.element(index)))

    def rowCount(self, parent: QModelIndex = _NOWHERE) -> int:
        hierarchy = self._presenter.hierarchy
        return 0 if hierarchy is None or parent.column() > 0 else len(hierarchy.children(self.element(parent)))

    def hasChildren(self, parent: QModelIndex = _NOWHERE) -> bool:
        hierarchy = self._presenter.hierarchy
        return hierarchy is not None and parent.column() <= 0 and hierarchy.has_children(self.element(parent))

    def columnCount(self, parent: QModelIndex = _NOWHERE) -> int:
        return len(HEADERS)

    def headerData(self, section: int, orientation: int, role: int = Qt.DisplayRole) -> Any:
        return HEADERS[section] if role == Qt.DisplayRole and orientation == Qt.Horizontal else None

    def data(self, index: QModelIndex, role: int = Qt.DisplayRole) -> Any:
        hierarchy = self._presenter.hierarchy
        if role not in _ROLES or hierarchy is None or not index.isValid():
            return None
        eid = self._ids[index.internalId()]
        if role in (Qt.DisplayRole, Qt.AccessibleTextRole):
            return self._text(eid, index.column())
        if role == Qt.ToolTipRole:
            return self._tip(eid)
        highlight = self._presenter.highlights.get(eid)
        if role == Qt.ForegroundRole:
            if highlight is not None:
                return theme.role_colour("changed")
            if eid == UNPLACED:
                return theme.role_colour("idle")
        if role == Qt.BackgroundRole and highlight is not None:
            colour = QColor(theme.role_colour("changed"))
            colour.setAlpha(40)
            return colour
        if role == Qt.FontRole and (eid in self._found or eid == UNPLACED):
            font = QFont()
            font.setBold(eid in self._found)
            font.setItalic(eid == UNPLACED)
            return font
        return None

    def _text(self, eid: str, column: int) -> str:
        hierarchy = self._presenter.hierarchy
        assert hierarchy is not None
        if column == 0:
            name = display_name(hierarchy, eid)
            return f"{name} ({len(hierarchy.children(UNPLACED))})" if eid == UNPLACED else name
        record = hierarchy.scene.record(eid)
        if column == 1:
            return local_name(record.type) if record is not None else ""
        highlight = self._presenter.highlights.get(eid)
        return f"● {highlight.author.strip('/')}" if highlight is not None else ""

    def _tip(self, eid: str) -> str:
        hierarchy, vocabulary = self._presenter.hierarchy, self._presenter.vocabulary
        assert hierarchy is not None
        if eid == UNPLACED:
            return "Elements without parent: skills, parameters, elements without location"
        record = hierarchy.scene.record(eid)
        if record is None:
            return eid
        lines = [eid, vocabulary.description(record.type) if vocabulary is not None else ""]
        if record.change_info.author:
            when = time.strftime("%H:%M:%S", time.localtime(record.change_info.stamp))
            lines.append(f"Last changed by {record.change_info.author.strip('/')} at {when}")
        return "\n".join(line for line in lines if line)

    # -- drag and drop -----------------------------------------------------------------------------------------

    def flags(self, index: QModelIndex) -> Any:
        flags = super().flags(index)
        eid = self.element(index)
        if eid in (TOP, UNPLACED):
            return flags
        return flags | Qt.ItemIsDropEnabled | (Qt.ItemIsDragEnabled if eid != ROOT else Qt.NoItemFlags)

    def supportedDropActions(self) -> Any:
        return Qt.MoveAction

    def mimeTypes(self) -> list[str]:
        return [_MIME]

    def mimeData(self, indexes: list[QModelIndex]) -> QMimeData:
        data = QMimeData()
        ids = dict.fromkeys(self.element(index) for index in indexes)
        data.setData(_MIME, "\n".join(ids).encode())
        return data

    def dropMimeData(self, data: QMimeData, action: int, row: int, column: int, parent: QModelIndex) -> bool:
        target = self.element(parent)
        if data.hasFormat(_MIME) and target not in (TOP, UNPLACED):
            self.dropped.emit(bytes(data.data(_MIME)).decode().splitlines(), target)
        return False  # the tree follows the scene


#: The columns but the first: their width in letters, and the largest share of the tree's width.
_WIDTHS = ((1, 13, 0.23), (2, 20, 0.27))

#: The delay of the search after a key (ms).
_DELAY = 150


class SceneTree(QTreeView):
    """Keeps branches expanded when the scene is replaced."""

    def __init__(self, model: SceneModel, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._model = model
        self._opened: dict[str, None] = {ROOT: None}  # expanded branches, in order
        self.setObjectName("sceneTree")
        self.setModel(model)
        self.setUniformRowHeights(True)
        self.setSelectionMode(QAbstractItemView.ExtendedSelection)
        self.setDragDropMode(QAbstractItemView.InternalMove)
        self.setContextMenuPolicy(Qt.CustomContextMenu)
        self.setAllColumnsShowFocus(True)
        header = self.header()
        header.setStretchLastSection(False)
        header.setSectionResizeMode(0, QHeaderView.Stretch)
        for column, *_ in _WIDTHS:
            header.setSectionResizeMode(column, QHeaderView.Interactive)
        model.redrawn.connect(self.viewport().update)
        self.expanded.connect(lambda index: self._opened.update({model.element(index): None}))
        self.collapsed.connect(lambda index: self._opened.pop(model.element(index), None))

    def show_scene(self) -> None:
        """Shows the presenter's scene."""
        opened = list(self._opened)
        self._model.show_scene()
        for eid in opened:
            index = self._model.index_of(eid)
            if index.isValid():
                self.setExpanded(index, True)
            elif self._model.rowCount():
                del self._opened[eid]

    def changeEvent(self, event: Any) -> None:
        super().changeEvent(event)
        if event.type() == QEvent.FontChange:
            self._set_widths()

    def resizeEvent(self, event: Any) -> None:
        super().resizeEvent(event)
        if event.oldSize().width() != event.size().width():
            self._set_widths()

    def _set_widths(self) -> None:
        for column, letters, share in _WIDTHS:
            most = int(self.width() * share)
            self.header().resizeSection(column, min(most, self.fontMetrics().averageCharWidth() * letters))


class ElementFinder(QWidget):
    """Searches while the user types, and goes through the results."""

    def __init__(self, presenter: WorldPresenter, model: SceneModel, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._presenter = presenter
        self._model = model
        self._found: list[str] = []
        self.line = QLineEdit()
        self.line.setObjectName("worldSearch")
        self.line.setPlaceholderText("Find an element (Ctrl+F)")
        self.line.setToolTip("Words in ids, labels and values; Enter, F3: next result, Shift+F3: previous")
        self.line.setClearButtonEnabled(True)
        self.line.returnPressed.connect(lambda: self.go_to_next())
        self.message = PlainLabel()
        self._timer = timer(self, _DELAY, self.search)
        self.line.textChanged.connect(lambda _: self._timer.start())
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(self.line, 1)
        row.addWidget(self.message)
        self.setFocusProxy(self.line)

    def close_finder(self) -> None:
        """Stops the timer."""
        self._timer.stop()

    def search(self) -> None:
        """Updates the results."""
        self._timer.stop()
        self._found = self._presenter.find(self.line.text())
        self._model.show_found(self._found)
        self._show_count()

    def go_to_next(self, step: int = 1) -> None:
        """Selects the next result.

        :param step: -1 for the previous one.
        """
        if self._timer.isActive():
            self.search()
        if not self._found:
            return
        selected = self._presenter.selected
        if selected in self._found:
            at = (self._found.index(selected) + step) % len(self._found)
        else:
            at = 0 if step > 0 else -1
        self._presenter.select(self._found[at])
        self._show_count()

    def _show_count(self) -> None:
        count, selected = len(self._found), self._presenter.selected
        if not self.line.text().strip():
            self.message.setText("")
        elif not count:
            self.message.setText("none")
        else:
            text = f"{self._found.index(selected) + 1} of {count}" if selected in self._found else f"{count} found"
            self.message.setText(text)
