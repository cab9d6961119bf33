"""The tree of robots and skills, with a search."""

from __future__ import annotations

from typing import Any

from python_qt_binding.QtCore import QSignalBlocker, Qt
from python_qt_binding.QtWidgets import QAbstractItemView, QLineEdit, QTreeWidget, QTreeWidgetItem, QVBoxLayout, QWidget

from skiros2_gui.app.widgets.controls import plain_tip
from skiros2_gui.skills.catalogue import Offer
from skiros2_gui.skills.presenter import SkillsPresenter

_KEY = Qt.UserRole


class SkillTree(QWidget):
    """Shows the presenter's tree."""

    def __init__(self, skills: SkillsPresenter, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._skills = skills
        self._folded: set[Any] = set()
        self.search = QLineEdit()
        self.search.setObjectName("skillSearch")
        self.search.setPlaceholderText("Search skills and parameters  (Ctrl+F)")
        self.search.setToolTip("Shows the skills that have all of these words in their names or parameters")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(skills.search_for)
        self.search.returnPressed.connect(self._choose_first)
        self.tree = QTreeWidget()
        self.tree.setObjectName("skillTree")
        self.tree.setHeaderHidden(True)
        self.tree.setUniformRowHeights(True)
        self.tree.setSelectionMode(QAbstractItemView.SingleSelection)
        self.tree.setAccessibleName("Skills")
        self.tree.currentItemChanged.connect(self._chosen)
        self.tree.itemCollapsed.connect(lambda item: self._folded.add(item.data(0, _KEY)))
        self.tree.itemExpanded.connect(lambda item: self._folded.discard(item.data(0, _KEY)))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.search)
        column.addWidget(self.tree, 1)
        skills.on_rows = self.show_rows
        self.show_rows()

    def show_rows(self) -> None:
        """Updates the tree and keeps the selection."""
        chosen = self._skills.form.offer.key if self._skills.form is not None else None
        rows = self._skills.rows
        with QSignalBlocker(self.tree):
            self.tree.clear()
            for robot in rows:
                top = _item(robot.manager.lstrip("/"), robot.manager, f"Robot {robot.manager}")
                self.tree.addTopLevelItem(top)
                for row in robot.skills:
                    item = _skill_item(row.offer)
                    top.addChild(item)
                    item.addChildren([_skill_item(offer) for offer in row.children])
                    self._unfold(item)
                self._unfold(top)
            if not rows:
                text = "No skill matches." if self._skills.search else "No robot is running."
                empty = _item(text, None, "")
                empty.setFlags(Qt.NoItemFlags)
                self.tree.addTopLevelItem(empty)
            self._select(chosen)

    def choose(self, key: tuple[str, str, str]) -> None:
        """Selects a skill."""
        item = self._find(key)
        if item is not None:
            self.tree.setCurrentItem(item)

    def _unfold(self, item: QTreeWidgetItem) -> None:
        item.setExpanded(item.data(0, _KEY) not in self._folded or bool(self._skills.search))

    def _select(self, key: tuple[str, str, str] | None) -> None:
        item = self._find(key) if key is not None else None
        if item is not None:
            self.tree.setCurrentItem(item)

    def _find(self, key: tuple[str, str, str]) -> QTreeWidgetItem | None:
        waiting = [self.tree.topLevelItem(i) for i in range(self.tree.topLevelItemCount())]
        for item in waiting:
            if item.data(0, _KEY) == key:
                return item
            waiting += [item.child(i) for i in range(item.childCount())]
        return None

    def _chosen(self, item: QTreeWidgetItem | None) -> None:
        key = item.data(0, _KEY) if item is not None else None
        if isinstance(key, tuple):
            self._skills.choose(key)

    def _choose_first(self) -> None:
        """Selects the first skill found and gives the focus to the tree."""
        for row in (row for robot in self._skills.rows for row in robot.skills):
            self.choose(row.offer.key)
            self.tree.setFocus()
            return


def _item(text: str, key: Any, tip: str) -> QTreeWidgetItem:
    item = QTreeWidgetItem([text])
    item.setData(0, _KEY, key)
    item.setToolTip(0, plain_tip(tip))
    return item


def _skill_item(offer: Offer) -> QTreeWidgetItem:
    which = "any implementation, as the robot chooses" if not offer.label else f"implementation {offer.label}"
    return _item(offer.name, offer.key, f"{offer.type}, {which}")
