"""The tree of the scene, and the search above it."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtCore import QEvent, Qt, QTimer
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QTreeView,
    QWidget,
)

from skiros2_gui.world.presenter import WorldPresenter
from skiros2_gui.world.widgets.scene_model import SceneModel
from skiros2_world_model.core.scene import ROOT

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
        self.message = QLabel()
        self._timer = QTimer(self)
        self._timer.setInterval(_DELAY)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self.search)
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
