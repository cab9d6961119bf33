"""The tab "World model"."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QKeySequence
from python_qt_binding.QtWidgets import (
    QHBoxLayout,
    QInputDialog,
    QMenu,
    QShortcut,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from skiros2_common.core.names import local_name
from skiros2_gui.app.widgets.controls import plain_tip, timer, tool_button
from skiros2_gui.app.window import Window
from skiros2_gui.teach.widgets.panel import TeachPanel
from skiros2_gui.world.presenter import Redraw, WorldPresenter
from skiros2_gui.world.queries import WorldQueries
from skiros2_gui.world.scene import TOP, UNPLACED
from skiros2_gui.world.widgets.dialogs import AddDialog, ClassDialog, RemoveDialog
from skiros2_gui.world.widgets.element import ElementPanel
from skiros2_gui.world.widgets.reports import HistoryPanel, QueryPanel, ReportPanel
from skiros2_gui.world.widgets.scene_tree import ElementFinder, SceneModel, SceneTree
from skiros2_live.core.patch import WORLD_MODEL
from skiros2_world_model.core.scene import ROOT

#: The period of checks for old highlights (ms).
_HIGHLIGHT_PERIOD = _CHECK_PERIOD = 1000


class WorldTab(QWidget):
    """See `app.widgets.main_widget.Tab`."""

    title = "World model"
    needs = (WORLD_MODEL,)

    def __init__(self, window: Window, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.presenter = WorldPresenter(window)
        self.queries = WorldQueries(window)
        self._file = ""
        self._is_following = False
        self.model = SceneModel(self.presenter)
        self.model.dropped.connect(self._move)
        self.tree = SceneTree(self.model)
        self.tree.customContextMenuRequested.connect(self._open_menu)
        self.tree.selectionModel().currentChanged.connect(lambda *_: self._select())
        for key, call in ((Qt.Key_Delete, self.remove), (Qt.Key_Insert, self.add), (Qt.Key_F2, self._edit_label)):
            QShortcut(QKeySequence(key), self.tree, call, context=Qt.WidgetShortcut)
        self.finder = ElementFinder(self.presenter, self.model)
        self.element = ElementPanel(self.presenter)
        self.history = HistoryPanel(self.presenter, self.queries)
        self.query = QueryPanel(self.presenter, self.queries)
        self.report = ReportPanel(self.presenter, self.queries)
        self.teach = TeachPanel(self.presenter)
        self.pages = QTabWidget()
        self.pages.setDocumentMode(True)
        for page, name, tip in (
            (self.element, "Element", "The selected element: properties and relations"),
            (self.history, "History", "Changes of the selected element, with time and author"),
            (self.query, "Query", "SPARQL queries of the scene and the ontologies"),
            (self.report, "Validation", "Violations of ontologies and shapes"),
            (self.teach, "Teach", "Taught poses and paths of the selected object"),
        ):
            self.pages.setTabToolTip(self.pages.addTab(page, name), tip)
        self._lay_out()
        self._highlight_timer = timer(self, _HIGHLIGHT_PERIOD, self._expire_highlights, repeats=True)
        self._check_timer = timer(self, _CHECK_PERIOD, self.presenter.check, repeats=True)
        self._check_timer.start()
        self.presenter.on_change = self._on_change
        self._on_change(Redraw.SCENE | Redraw.UNDO)

    def _lay_out(self) -> None:
        self.add_button = tool_button("Add…", "addButton", self.add, "Adds an element under the selected one (Insert)")
        self.remove_button = tool_button("Remove…", "removeButton", self.remove, "Removes the selected ones (Delete)")
        self.undo_button = tool_button("Undo", "undoButton", self.presenter.undo)
        self.redo_button = tool_button("Redo", "redoButton", self.presenter.redo)
        self.file_button = tool_button("Scene", "fileButton", tip="Loads and saves the scene, and validates it")
        menu = QMenu(self.file_button)
        for text, name, call in (
            ("Load…", "loadAction", self.load),
            ("Save…", "saveAction", self.save),
            ("Validate", "validateAction", self.validate),
        ):
            menu.addAction(text, call).setObjectName(name)
        self.file_button.setMenu(menu)
        bar = QHBoxLayout()
        bar.addWidget(self.finder, 1)
        for button in (self.add_button, self.remove_button, self.undo_button, self.redo_button, self.file_button):
            bar.addWidget(button)
        self.splitter = QSplitter(Qt.Horizontal)
        self.splitter.addWidget(self.tree)
        self.splitter.addWidget(self.pages)
        self.splitter.setStretchFactor(0, 5)
        self.splitter.setStretchFactor(1, 6)
        em = self.fontMetrics().height()
        self.splitter.setSizes([25 * em, 30 * em])
        self.splitter.setChildrenCollapsible(False)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.addLayout(bar)
        column.addWidget(self.splitter, 1)
        for keys, call in (
            ("Ctrl+Z", self.presenter.undo),
            ("Ctrl+Shift+Z", self.presenter.redo),
            ("Ctrl+Y", self.presenter.redo),
            ("F3", self.finder.go_to_next),
            ("Shift+F3", lambda: self.finder.go_to_next(-1)),
        ):
            QShortcut(QKeySequence(keys), self, call, context=Qt.WidgetWithChildrenShortcut)

    # -- Tab -------------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        return {
            "sizes": self.splitter.sizes(),
            "page": self.pages.currentIndex(),
            "query": self.query.box.toPlainText(),
            "queries": self.queries.queries,
            "file": self._file,
        }

    def restore(self, settings: Mapping[str, Any]) -> None:
        sizes, page = settings.get("sizes"), settings.get("page")
        if isinstance(sizes, list) and len(sizes) == 2 and all(isinstance(size, int) and size > 0 for size in sizes):
            self.splitter.setSizes(sizes)
        if isinstance(page, int) and 0 <= page < self.pages.count():
            self.pages.setCurrentIndex(page)
        if isinstance(settings.get("query"), str):
            self.query.box.setPlainText(settings["query"])
        queries = settings.get("queries")
        if isinstance(queries, list):
            self.queries.queries = [text for text in queries if isinstance(text, str)]
        if isinstance(settings.get("file"), str):
            self._file = settings["file"]

    def find(self) -> None:
        self.finder.line.setFocus(Qt.ShortcutFocusReason)
        self.finder.line.selectAll()

    def toggle(self) -> None:
        """Expands or collapses the selected branch."""
        index = self.tree.currentIndex().siblingAtColumn(0)
        if index.isValid() and self.tree.hasFocus():
            self.tree.setExpanded(index, not self.tree.isExpanded(index))

    def close_tab(self) -> None:
        self.finder.close_finder()
        self.teach.close_timers()
        self._highlight_timer.stop()
        self._check_timer.stop()

    # -- showing ----------------------------------------------------------------------------------------------

    def _on_change(self, part: Redraw) -> None:
        if part & Redraw.SCENE:
            self.tree.show_scene()
            self.finder.search()
        if part & Redraw.DETAILS:
            self.element.show_details()
            self.history.show_element()
        if part & (Redraw.SCENE | Redraw.SELECTION):
            self._show_selection()
        if part & Redraw.UNDO:
            self._show_undo()
        if part & Redraw.HIGHLIGHTS:
            self.model.redrawn.emit()
            if self.presenter.highlights and not self._highlight_timer.isActive():
                self._highlight_timer.start()

    def _show_selection(self) -> None:
        index = self.model.index_of(self.presenter.selected)
        self._is_following = True
        if index.isValid():
            self.tree.setCurrentIndex(index)
            self.tree.scrollTo(index)
        else:
            self.tree.clearSelection()
        self._is_following = False

    def _show_undo(self) -> None:
        undo_stack = self.presenter.undo_stack
        for button, text, name, keys in (
            (self.undo_button, undo_stack.undo_text, "Undo", "Ctrl+Z"),
            (self.redo_button, undo_stack.redo_text, "Redo", "Ctrl+Shift+Z"),
        ):
            button.setEnabled(bool(text))
            button.setToolTip(plain_tip(f"{name}: {text} ({keys})" if text else f"Nothing to {name.lower()} ({keys})"))

    def _expire_highlights(self) -> None:
        self.presenter.expire_highlights()
        if not self.presenter.highlights:
            self._highlight_timer.stop()

    # -- selecting ---------------------------------------------------------------------------------------------

    def _select(self) -> None:
        if not self._is_following:
            eid = self.model.element(self.tree.currentIndex())
            self.presenter.select("" if eid in (TOP, UNPLACED) else eid, in_tree=True)

    def chosen(self) -> list[str]:
        """Returns the selected elements."""
        rows = self.tree.selectionModel().selectedRows()
        return [eid for index in rows if (eid := self.model.element(index)) not in (TOP, UNPLACED)]

    # -- changing ----------------------------------------------------------------------------------------------

    def add(self) -> None:
        """Opens the dialog that adds a child of the selected element."""
        if self.presenter.hierarchy is not None and self.presenter.vocabulary is not None:
            self._open(AddDialog(self.presenter, self.presenter.selected or ROOT, self))

    def remove(self) -> None:
        """Opens the dialog that removes the selected elements."""
        ids, requests = [eid for eid in self.chosen() if eid != ROOT], self.presenter.requests
        if not ids or requests is None:
            return
        removed = dict.fromkeys(one for eid in ids for one in requests.removed_with(eid))
        dialog = RemoveDialog(self.presenter, ids, list(removed), self)
        names = ", ".join(map(local_name, ids[:3])) + (", …" if len(ids) > 3 else "")
        dialog.accepted.connect(lambda: self.presenter.change(f"remove {names}", lambda r: r.remove(ids)))
        self._open(dialog)

    def _move(self, ids: list[str], parent: str) -> None:
        names = ", ".join(map(local_name, ids[:3])) + (", …" if len(ids) > 3 else "")
        self.presenter.change(
            f"move {names} to {local_name(parent)}", lambda r: [o for eid in ids for o in r.move(eid, parent)]
        )

    def _edit_label(self) -> None:
        self.pages.setCurrentWidget(self.element)
        self.element.label_edit.setFocus(Qt.ShortcutFocusReason)
        self.element.label_edit.selectAll()

    def change_class(self) -> None:
        """Opens the dialog that changes the class."""
        vocabulary, details = self.presenter.vocabulary, self.presenter.details()
        if vocabulary is not None and details is not None:
            dialog = ClassDialog(vocabulary, details.type, self)
            what = f"class of {local_name(details.id)}"
            dialog.chosen.connect(lambda etype: self.presenter.change(what, lambda r: r.set_type(details.id, etype)))
            self._open(dialog)

    def load(self) -> None:
        """Opens the dialog that loads a scene."""
        self._ask_file(
            "Load a scene",
            "⚠ The current scene is replaced for all robots; this cannot be undone.\nFile in the workspace",
            self.queries.load,
        )

    def save(self) -> None:
        """Opens the dialog that saves the scene."""
        self._ask_file("Save the scene", "File in the workspace", self.queries.save)

    def validate(self) -> None:
        """Validates the scene."""
        self.pages.setCurrentWidget(self.report)
        self.queries.validate()

    def _ask_file(self, title: str, label: str, use: Callable[[str], None]) -> None:
        """Asks for a file in the workspace of the world model, which may be on another machine."""

        def chosen(name: str) -> None:
            self._file = name.strip()
            use(self._file)

        dialog = QInputDialog(self)
        dialog.setWindowTitle(title)
        dialog.setLabelText(f"{label} of the world model (empty: the last one used)")
        dialog.setTextValue(self._file)
        dialog.textValueSelected.connect(chosen)
        self._open(dialog)

    def _open(self, dialog: Any) -> None:
        dialog.setAttribute(Qt.WA_DeleteOnClose)
        dialog.open()

    def _open_menu(self, at: Any) -> None:
        menu = QMenu(self)
        index = self.tree.indexAt(at)
        eid = self.model.element(index)
        for text, call, is_there in (
            ("Add an element here…", self.add, eid not in (TOP, UNPLACED)),
            ("Add a relation…", self.element.add_relation, eid not in (TOP, UNPLACED)),
            ("Edit the label", self._edit_label, eid not in (TOP, UNPLACED)),
            ("Change the class…", self.change_class, eid not in (TOP, UNPLACED, ROOT)),
            ("Remove…", self.remove, eid not in (TOP, UNPLACED, ROOT)),
            ("Open all below", lambda: self.tree.expandRecursively(index, 6), self.model.hasChildren(index)),
            ("Show the history", lambda: self.pages.setCurrentWidget(self.history), eid not in (TOP, UNPLACED)),
        ):
            menu.addAction(text, call).setEnabled(bool(is_there))
        menu.setAttribute(Qt.WA_DeleteOnClose)
        menu.popup(self.tree.viewport().mapToGlobal(at))
