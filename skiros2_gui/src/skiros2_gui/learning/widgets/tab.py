"""The tab "Learning": studies of a folder, their evaluations and pictures, replay, applying and taking back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from python_qt_binding.QtCore import Qt
from python_qt_binding.QtGui import QPixmap
from python_qt_binding.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QLineEdit,
    QScrollArea,
    QSplitter,
    QTabWidget,
    QVBoxLayout,
    QWidget,
)

from skiros2_gui.app.widgets.controls import PlainLabel, push_button, text_label
from skiros2_gui.app.widgets.tables import Row, RowsModel, RowsView
from skiros2_gui.app.window import Window
from skiros2_gui.learning import studies

#: Where `learn run` puts studies.
_FOLDER = "build/learning"
#: Jobs of this queue run one after another: reading a study, drawing it.
_QUEUE = "learning"


class LearningTab(QWidget):
    """Reads studies only on request: a folder is opened, a study is selected, or Refresh is pressed."""

    title = "Learning"
    needs: tuple[str, ...] = ()

    def __init__(self, window: Window) -> None:
        super().__init__()
        self._window = window
        self._view: studies.StudyView | None = None
        self._folder = QLineEdit(_FOLDER)
        self._folder.setObjectName("studyFolder")
        self._folder.setPlaceholderText("folder with studies")
        self._folder.returnPressed.connect(self.refresh)
        self._studies = RowsView(RowsModel(("Study", "Evaluations", "Best success", "Validated")), 0)
        self._studies.setObjectName("studyList")
        self._configurations = RowsView(RowsModel(("Evaluation", "Success", "Optimal")), 2)
        self._configurations.setObjectName("configurationList")
        for table, chosen in ((self._studies, self._read_chosen), (self._configurations, self._show_buttons)):
            table.setSelectionMode(QAbstractItemView.SingleSelection)
            table.selectionModel().currentChanged.connect(lambda *_, call=chosen: call())
        self._pictures = QTabWidget()
        self._pictures.setObjectName("studyPictures")
        self._sets = QComboBox()
        self._sets.setObjectName("appliedSets")
        self._status = text_label("learningStatus")
        self._validation = text_label("studyValidation")
        self._replay = push_button("Replay", "replayButton", self.replay, "Runs the evaluation again, without nodes")
        self._apply = push_button(
            "Apply", "applyButton", self.apply, "Stores the configuration: skills use it when they start"
        )
        self._revert = push_button("Revert", "revertButton", self.revert, "Removes the chosen configuration")
        self._lay_out()
        self._show_buttons()

    # -- as a tab ------------------------------------------------------------------------------------------------------

    def settings(self) -> dict[str, Any]:
        return {"folder": self._folder.text()}

    def restore(self, settings: Mapping[str, Any]) -> None:
        self._folder.setText(str(settings.get("folder", _FOLDER)))

    def find(self) -> None:
        self._folder.setFocus(Qt.ShortcutFocusReason)

    def toggle(self) -> None:
        """Does nothing: the tab runs no task."""

    def close_tab(self) -> None:
        """Does nothing: the jobs end with the window."""

    def showEvent(self, event: Any) -> None:
        super().showEvent(event)
        if not self._studies.rows.rows:
            self.refresh()
        self._read_sets()

    # -- actions -------------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Lists the studies of the folder, and reads the selected one again."""
        folder = Path(self._folder.text()).expanduser()
        self._run("listing the studies", partial(studies.list_studies, folder), self._show_studies)
        self._read_sets()

    def replay(self) -> None:
        """Runs the selected evaluation again, in the background."""
        chosen = self._chosen()
        if chosen is not None:
            self._status.setText(f"replaying evaluation {chosen[1]} ...")
            self._run("replaying an evaluation", partial(studies.replay, *chosen), self._status.setText, queue="")

    def apply(self) -> None:
        """Applies the selected configuration."""
        chosen, wmi = self._chosen(), self._window.system.world
        if chosen is not None and wmi is not None:
            self._run("applying a configuration", partial(studies.apply_configuration, wmi, *chosen), self._applied)

    def revert(self) -> None:
        """Removes the chosen parameter set."""
        eid, wmi = self._sets.currentData(), self._window.system.world
        if eid and wmi is not None:
            self._run("reverting a configuration", partial(studies.revert, wmi, eid), lambda _: self._removed(eid))

    # -- results -------------------------------------------------------------------------------------------------------

    def _show_studies(self, found: list[studies.ListedStudy]) -> None:
        rows = [
            Row(
                (each.name, f"{each.counted} of {each.budget}", f"{each.success:.0%}", each.validated or "no"),
                str(each.folder),
                each,
            )
            if not each.problem
            else Row((each.name, "", "cannot be read", ""), each.problem, each, "failure")
            for each in found
        ]
        self._studies.rows.show_rows(rows)
        self._status.setText("" if found else f"there is no study in {self._folder.text()}")
        self._read_chosen()

    def _read_chosen(self) -> None:
        index = self._studies.currentIndex()
        listed = self._studies.rows.rows[index.row()].item if index.isValid() else None
        if listed is not None and not listed.problem:
            self._run("reading a study", partial(studies.read_study, listed.folder), self._show_study)

    def _show_study(self, view: studies.StudyView) -> None:
        self._view = view
        self._validation.setText("\n".join(view.validation))
        rows = [
            Row((str(each.number), each.success, "yes" if each.is_optimal else "", *each.values), "", each)
            for each in view.configurations
        ]
        self._configurations.rows.show_rows(rows, ("Evaluation", "Success", "Optimal", *view.headers))
        shown = self._pictures.tabText(self._pictures.currentIndex())
        self._pictures.clear()
        for title, data in view.pictures.items():
            picture, pixels = PlainLabel(), QPixmap()
            pixels.loadFromData(data)
            picture.setPixmap(pixels)
            area = QScrollArea()
            area.setWidget(picture)
            self._pictures.addTab(area, title)
            if title == shown:
                self._pictures.setCurrentWidget(area)
        self._show_buttons()

    def _applied(self, ids: list[str]) -> None:
        self._status.setText(f"applied as {', '.join(ids)}")
        self._read_sets()

    def _removed(self, eid: str) -> None:
        self._status.setText(f"{eid} is reverted")
        self._read_sets()

    def _read_sets(self) -> None:
        wmi = self._window.system.world
        if wmi is not None:
            self._run("", partial(studies.applied_sets, wmi), self._show_sets)

    def _show_sets(self, found: list[studies.AppliedSet]) -> None:
        chosen = self._sets.currentData()
        self._sets.clear()
        for each in found:
            self._sets.addItem(f"{each.label} ({each.id})", each.id)
            self._sets.setItemData(self._sets.count() - 1, each.study, Qt.ToolTipRole)
        self._sets.setCurrentIndex(max(0, self._sets.findData(chosen)) if found else -1)
        self._show_buttons()

    # -- internal ------------------------------------------------------------------------------------------------------

    def _chosen(self) -> tuple[Path, int] | None:
        index = self._configurations.currentIndex()
        if self._view is None or not index.isValid():
            return None
        return self._view.folder, self._configurations.rows.rows[index.row()].item.number

    def _show_buttons(self) -> None:
        is_chosen, has_world = self._chosen() is not None, self._window.system.world is not None
        self._replay.setEnabled(is_chosen)
        self._apply.setEnabled(is_chosen and has_world)
        self._revert.setEnabled(self._sets.count() > 0 and has_world)

    def _run(self, activity: str, call: Callable[[], Any], done: Callable[[Any], None], queue: str = _QUEUE) -> None:
        self._window.jobs.run(call, done, activity=activity, queue=queue)

    def _browse(self) -> None:
        folder = QFileDialog.getExistingDirectory(self, "Folder with studies", self._folder.text())
        if folder:
            self._folder.setText(folder)
            self.refresh()

    def _lay_out(self) -> None:
        top = QHBoxLayout()
        top.addWidget(self._folder, 1)
        top.addWidget(push_button("Browse…", "browseButton", self._browse, "Chooses another folder"))
        top.addWidget(push_button("Refresh", "refreshButton", self.refresh, "Reads the studies again"))
        actions = QHBoxLayout()
        actions.addWidget(self._replay)
        actions.addWidget(self._apply)
        actions.addStretch(1)
        actions.addWidget(PlainLabel("Applied:"))
        actions.addWidget(self._sets, 1)
        actions.addWidget(self._revert)
        left = QSplitter(Qt.Vertical)
        left.addWidget(self._studies)
        left.addWidget(self._configurations)
        left.setStretchFactor(1, 1)
        both = QSplitter(Qt.Horizontal)
        both.addWidget(left)
        both.addWidget(self._pictures)
        both.setStretchFactor(1, 1)
        column = QVBoxLayout(self)
        column.addLayout(top)
        column.addWidget(both, 1)
        column.addWidget(self._validation)
        column.addLayout(actions)
        column.addWidget(self._status)
