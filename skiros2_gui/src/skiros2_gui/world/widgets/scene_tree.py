"""The Qt view of the scene's tree."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtCore import QEvent, Qt
from python_qt_binding.QtWidgets import QAbstractItemView, QHeaderView, QTreeView, QWidget

from skiros2_gui.world.widgets.scene_model import SceneModel
from skiros2_world_model.core.scene import ROOT

#: The columns but the first: their width in letters, and the largest share of the tree's width.
_WIDTHS = ((1, 13, 0.23), (2, 20, 0.27))


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
