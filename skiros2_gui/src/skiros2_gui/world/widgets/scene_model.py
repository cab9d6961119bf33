"""The Qt model of the scene's tree."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

from python_qt_binding.QtCore import QAbstractItemModel, QMimeData, QModelIndex, Qt, Signal
from python_qt_binding.QtGui import QColor, QFont

from skiros2_common.core.names import local_name
from skiros2_gui.app.widgets import theme
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
        if record.provenance.author:
            when = time.strftime("%H:%M:%S", time.localtime(record.provenance.stamp))
            lines.append(f"Last changed by {record.provenance.author.strip('/')} at {when}")
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
