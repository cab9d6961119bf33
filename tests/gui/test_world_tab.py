"""The widgets of the tab "World model"."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pytestqt.modeltest import ModelTester
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QItemSelectionModel, QModelIndex, Qt
from python_qt_binding.QtGui import QTextDocument
from python_qt_binding.QtWidgets import QComboBox, QDialog, QLabel, QLineEdit

from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import WorldChanged
from skiros2_gui.app.widgets.controls import plain_tip
from skiros2_gui.app.window import Window
from skiros2_gui.world.scene import UNPLACED
from skiros2_gui.world.widgets.dialogs import (
    AddDialog,
    ClassDialog,
    PropertyDialog,
    RelationDialog,
    RemoveDialog,
    ValuesDialog,
)
from skiros2_gui.world.widgets.tab import WorldTab
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.scene import ROOT
from support.window.local_system import LocalSystem
from support.window.synchronous import make_window

BOX = "skiros:LargeBox"


class Desk:
    """The tab on a world model of this process."""

    def __init__(self, qtbot: QtBot) -> None:
        self.qtbot = qtbot
        self.wm = LocalWorldModel("window")
        self.other = LocalWorldModel("vision", self.wm.model)
        self.window: Window = make_window(lambda event_queue: LocalSystem(event_queue, self.wm))
        self.tab = WorldTab(self.window)
        qtbot.addWidget(self.tab, before_close_func=WorldTab.close_tab)
        self.tab.resize(1100, 700)
        self.tab.show()

    def add(self, label: str = "", parent: str = ROOT, etype: str = BOX) -> str:
        """Somebody else adds an element; returns its id."""
        element = Element(etype, label)
        element.addRelation(parent, "skiros:contain", "-1")
        self.other.add_element(element)
        self.window.process_events()
        return element.id

    def select(self, eid: str) -> None:
        """A click on an element in the tree."""
        index = self.tab.model.index_of(eid)
        self.tab.tree.scrollTo(index)
        place = self.tab.tree.visualRect(index).center()
        self.qtbot.mouseClick(self.tab.tree.viewport(), Qt.LeftButton, pos=place)

    def dialog(self, kind: type[QDialog]) -> QDialog:
        return next(d for d in self.tab.findChildren(kind) if d.isVisible())

    def press(self, dialog: QDialog) -> None:
        """OK."""
        self.qtbot.mouseClick(dialog.ok, Qt.LeftButton)
        self.window.process_events()

    def rows(self, parent: QModelIndex | None = None) -> list[str]:
        """What the tree shows directly under a row."""
        model, parent = self.tab.model, parent or QModelIndex()
        return [model.index(row, 0, parent).data() for row in range(model.rowCount(parent))]


@pytest.fixture
def desk(qtbot: QtBot) -> Iterator[Desk]:
    yield Desk(qtbot)


def test_scene_model_passes_model_tester(desk: Desk) -> None:
    tester = ModelTester(desk.tab.model)
    tester.check(desk.tab.model, force_py=True)
    box = desk.add()
    parts = [desk.add(parent=box, etype="skiros:Part") for _ in range(3)]
    desk.tab.tree.expandAll()
    desk.tab.presenter.change("move", lambda r: r.move(parts[1], ROOT))
    desk.window.process_events()
    desk.other.remove_element(desk.other.get_element(box))
    desk.window.process_events()
    assert desk.rows(desk.tab.model.index_of(ROOT)) == [parts[1].partition(":")[2]]
    tester._cleanup()


def test_elements_of_others_are_highlighted_and_selection_is_kept(desk: Desk) -> None:
    box = desk.add("skiros:first")
    desk.select(box)
    new = desk.add("skiros:second")
    index = desk.tab.model.index_of(new)
    assert index.data() == "second"
    assert index.siblingAtColumn(2).data() == "● vision"
    assert desk.tab.presenter.selected == box


def test_value_is_edited_in_the_table(desk: Desk) -> None:
    box = desk.add()
    desk.tab.presenter.change("weight", lambda r: r.set_values(box, "skiros:Weight", ["1"]))
    desk.window.process_events()
    desk.select(box)
    table = desk.tab.element.properties
    assert [table.model().index(0, column).data() for column in range(3)] == ["Weight", "1", "kg"]
    for text, weight in (("2.5 kg", 2.5), ("heavy", 2.5)):
        table.edit(table.model().index(0, 1))
        editor = table.findChild(QLineEdit)
        editor.setText(text)
        desk.qtbot.keyClick(editor, Qt.Key_Return)
        desk.qtbot.waitUntil(lambda: not table.findChildren(QLineEdit))
        desk.window.process_events()
        assert desk.wm.get_element(box).value_of("skiros:Weight") == weight
    assert "expected a number (in kg), got 'heavy'" in desk.window.problems.newest.line


def test_open_editor_is_kept_when_others_change_the_element(desk: Desk) -> None:
    box = desk.add()
    desk.tab.presenter.change("weight", lambda r: r.set_values(box, "skiros:Weight", ["1"]))
    desk.window.process_events()
    desk.select(box)
    table = desk.tab.element.properties
    table.edit(table.model().index(0, 1))
    table.findChild(QLineEdit).setText("2")
    element = desk.other.get_element(box)
    element.label = "skiros:moved"
    desk.other.update_element(element)
    desk.window.process_events()
    assert table.findChild(QLineEdit).text() == "2"
    assert desk.tab.element.label_edit.text() == "skiros:moved"


def test_edited_label_follows_the_scene(desk: Desk) -> None:
    box = desk.add("skiros:first")
    desk.select(box)
    label = desk.tab.element.label_edit
    label.setFocus()
    label.clear()
    desk.qtbot.keyClicks(label, "skiros:mine")
    desk.qtbot.keyClick(label, Qt.Key_Return)
    desk.window.process_events()
    assert desk.wm.get_element(box).label == "skiros:mine"
    desk.tab.presenter.undo()
    desk.window.process_events()
    assert label.text() == "skiros:first"


def test_pose_editor_writes_edited_numbers_and_keeps_the_others(desk: Desk) -> None:
    box = desk.add()
    desk.tab.presenter.change("pose", lambda r: r.set_pose(box, (1 / 3, 0.0, 0.0), (0.0, 0.0, 10.0)))
    desk.window.process_events()
    desk.select(box)
    pose = desk.tab.element.pose
    assert [number.text() for number in pose.boxes] == ["0.3333 m", "0 m", "0 m", "0°", "0°", "10°"]
    pose.boxes[2].setValue(0.5)
    pose.boxes[3].setValue(-30.0)
    pose.flush()
    element = desk.wm.get_element(box)
    assert (element.value_of("skiros:PositionX"), element.value_of("skiros:PositionZ")) == (1 / 3, 0.5)
    desk.window.process_events()
    assert [number.text() for number in pose.boxes[2:]] == ["0.5 m", "-30°", "0°", "10°"]
    names = {row.cells[0] for row in desk.tab.element.properties.rows.rows}
    assert not names & {"PositionX", "OrientationW", "Roll"}


def test_pending_pose_is_written_before_another_element_is_shown(desk: Desk) -> None:
    box, other = desk.add(), desk.add()
    desk.select(box)
    desk.tab.element.pose.boxes[0].setValue(2.0)
    desk.select(other)
    assert desk.wm.get_element(box).value_of("skiros:PositionX") == 2.0
    assert desk.tab.element.pose.boxes[0].value() == 0.0


def test_values_dialog_edits_lists_and_tables(desk: Desk) -> None:
    box = desk.add()
    element = desk.other.get_element(box)
    element.setProperty("skiros:CadModel", ["a.stl", "b.stl"])
    element.setProperty("skiros:Value", {"grip": [1, 2]})
    desk.other.update_element(element)
    desk.window.process_events()
    desk.select(box)
    table = desk.tab.element.properties
    writes = (("CadModel", "a.stl\nb.stl", "c.stl\nd.stl"), ("Value", '{"grip": [1, 2]}', '{"x": 1}'))
    for name, before, after in writes:
        names = [table.rows.index(row, 0).data() for row in range(table.rows.rowCount())]
        table.doubleClicked.emit(table.rows.index(names.index(name), 1))
        dialog = desk.dialog(ValuesDialog)
        assert dialog.box.toPlainText() == before
        dialog.box.setPlainText(after)
        desk.press(dialog)
    element = desk.wm.get_element(box)
    assert element.getProperty("skiros:CadModel").values == ["c.stl", "d.stl"]
    assert element.value_of("skiros:Value") == {"x": 1}
    told = desk.tab.presenter.change("value", lambda r: r.set_values(box, "skiros:Value", ["[1]"]))
    assert told == "Value: expected a table, such as {\"key\": 1}, got '[1]'"


def test_class_dialog_changes_the_class(desk: Desk) -> None:
    box = desk.add()
    desk.select(box)
    desk.tab.change_class()
    dialog = desk.dialog(ClassDialog)
    assert dialog.choice.chosen().name == BOX
    dialog.choice.choose("skiros:Container")
    desk.press(dialog)
    assert desk.wm.get_element(box).type == "skiros:Container"


def test_add_dialog_adds_an_element(desk: Desk) -> None:
    box = desk.add()
    desk.select(box)
    desk.tab.add_button.click()
    dialog = desk.dialog(AddDialog)
    assert not dialog.ok.isEnabled()
    desk.qtbot.keyClicks(dialog.choice.search, "starter motor")
    dialog.choice.choose("skiros:Starter")
    dialog.label.setText("skiros:mine")
    desk.press(dialog)
    added = desk.tab.presenter.selected
    assert desk.wm.get_element(added).label == "skiros:mine"
    assert desk.wm.get_relations(box, "skiros:contain", added)


def test_remove_dialog_lists_descendants_and_can_be_undone(desk: Desk) -> None:
    box = desk.add()
    part = desk.add("skiros:screw", parent=box, etype="skiros:Part")
    desk.select(box)
    desk.qtbot.keyClick(desk.tab.tree, Qt.Key_Delete)
    dialog = desk.dialog(RemoveDialog)
    assert "Also removes one element below it:\nscrew" in dialog.note.text()
    desk.press(dialog)
    assert desk.wm.find_element(part) is None
    desk.tab.undo_button.click()
    desk.window.process_events()
    assert desk.wm.get_relations(box, "skiros:contain", part)
    assert desk.tab.redo_button.isEnabled()


def _choose(desk: Desk, box: QComboBox, text: str) -> None:
    box.lineEdit().selectAll()
    desk.qtbot.keyClicks(box.lineEdit(), text)
    desk.qtbot.keyClick(box.lineEdit(), Qt.Key_Return)


def test_relation_dialog_adds_a_relation(desk: Desk) -> None:
    box, part = desk.add(), desk.add("skiros:screw", etype="skiros:Part")
    desk.select(box)
    desk.tab.element.add_relation_button.click()
    dialog = desk.dialog(RelationDialog)
    names = [dialog.predicate.itemData(i) for i in range(dialog.predicate.count())]
    assert {"skiros:contain", "skiros:at", "cora:robotPart"} <= set(names)
    assert not dialog.ok.isEnabled()
    _choose(desk, dialog.other, "screw")
    _choose(desk, dialog.predicate, "cora:robotPart")
    assert "the subject of cora:robotPart is a sumo:Device, which skiros:LargeBox is not" in dialog.note.text()
    assert not desk.wm.get_relations(box, "cora:robotPart", part)
    _choose(desk, dialog.predicate, "skiros:at")
    desk.press(dialog)
    assert desk.wm.get_relations(box, "skiros:at", part)


def test_property_dialog_checks_the_value(desk: Desk) -> None:
    box = desk.add()
    desk.select(box)
    desk.tab.element.add_property_button.click()
    dialog = desk.dialog(PropertyDialog)
    dialog.key.setEditText("Weight")
    dialog.value.setText("a lot")
    assert not dialog.ok.isEnabled() and "expected a number (in kg)" in dialog.note.text()
    dialog.value.setText("4")
    desk.press(dialog)
    assert desk.wm.get_element(box).value_of("skiros:Weight") == 4.0


def test_dropped_element_is_moved(desk: Desk) -> None:
    box, part = desk.add(), desk.add(etype="skiros:Part")
    model = desk.tab.model
    data = model.mimeData([model.index_of(part)])
    model.dropMimeData(data, Qt.MoveAction, -1, -1, model.index_of(box))
    desk.window.process_events()
    assert model.parent(model.index_of(part)) == model.index_of(box)
    assert not model.flags(model.index_of(ROOT)) & Qt.ItemIsDragEnabled
    assert not model.flags(model.index_of(UNPLACED)) & Qt.ItemIsDropEnabled


def test_finder_cycles_through_results(desk: Desk) -> None:
    first, second = desk.add("skiros:starter"), desk.add("skiros:starter")
    desk.add("skiros:other")
    desk.tab.find()
    desk.qtbot.keyClicks(desk.tab.finder.line, "Starter")
    seen = []
    for _ in range(3):
        desk.qtbot.keyClick(desk.tab.finder.line, Qt.Key_Return)
        seen.append(desk.tab.presenter.selected)
    assert seen == [first, second, first]
    assert desk.tab.finder.message.text() == "1 of 2"


def test_query_panel_shows_results_and_error_line(desk: Desk) -> None:
    box = desk.add()
    query = desk.tab.query
    query.box.setPlainText("SELECT ?what WHERE { skiros:Scene\\-0 skiros:contain ?what }")
    query.run.click()
    assert query.table.model().index(0, 0).data() == box
    query.table.doubleClicked.emit(query.table.model().index(0, 0))
    assert desk.tab.presenter.selected == box
    query.box.setPlainText("SELECT ?what WHERE {\n  ?what skiros:contain\n}")
    query.run.click()
    assert "line 3, column 1: " in query.message.text()
    assert query.table.model().rowCount() == 0
    assert [s.cursor.blockNumber() for s in query.box.extraSelections()] == [2]


def test_click_on_a_violation_selects_the_element(desk: Desk) -> None:
    box = desk.add()
    desk.tab.presenter.change("free it", lambda r: r.unrelate(ROOT, "skiros:contain", box))
    desk.window.process_events()
    desk.tab.validate()
    table = desk.tab.report.table
    texts = [table.model().index(row, 1).data() for row in range(table.model().rowCount())]
    table.selectRow(texts.index(box.partition(":")[2]))
    assert desk.tab.presenter.selected == box


def test_history_without_journal_shows_a_message(desk: Desk) -> None:
    desk.select(desk.add())
    desk.tab.pages.setCurrentWidget(desk.tab.history)
    assert desk.tab.history.message.text() == "The world model has no journal, so its history is unknown"


def test_label_with_tags_is_shown_as_it_is(desk: Desk) -> None:
    fake = "<b>a speck of dust</b><br>nothing else is removed<div hidden>"
    box = desk.add(fake)
    desk.add("screw", box)
    desk.select(box)
    desk.tab.remove_button.click()
    dialog = desk.dialog(RemoveDialog)
    labels = [label for label in (*dialog.findChildren(QLabel), *desk.tab.findChildren(QLabel)) if fake in label.text()]
    assert dialog.text in labels
    assert {label.textFormat() for label in labels} == {Qt.PlainText}
    dialog.reject()
    tip = plain_tip(fake)
    document = QTextDocument()
    document.setHtml(tip)
    assert document.toPlainText() == fake


def test_marks_in_a_label_that_reverse_text_are_shown(desk: Desk) -> None:
    box = desk.add("cup\u202e reyaol\u2066\x07")
    desk.select(box)
    desk.tab.remove_button.click()
    dialog = desk.dialog(RemoveDialog)
    shown = "cup\\u202e reyaol\\u2066\\x07"
    assert shown in dialog.text.text()
    assert desk.tab.element.heading.text() == shown
    dialog.reject()


def test_several_elements_are_removed_together(desk: Desk) -> None:
    boxes = [desk.add() for _ in range(3)]
    desk.select(boxes[0])
    model = desk.tab.tree.selectionModel()
    for eid in boxes[1:]:
        model.select(desk.tab.model.index_of(eid), QItemSelectionModel.Select | QItemSelectionModel.Rows)
    desk.tab.remove_button.click()
    desk.press(desk.dialog(RemoveDialog))
    assert desk.rows() == ["Scene", "Not placed (0)"]
    assert not desk.tab.model.hasChildren(desk.tab.model.index_of(ROOT))


def test_settings_are_restored_and_invalid_ones_skipped(desk: Desk) -> None:
    desk.tab.query.box.setPlainText("ASK {}")
    desk.tab.pages.setCurrentIndex(2)
    kept = desk.tab.settings()
    desk.tab.query.box.setPlainText("")
    desk.tab.restore({"page": 99, "sizes": ["x"], "query": 5, "queries": None, "file": []})
    desk.tab.restore(kept)
    assert desk.tab.query.box.toPlainText() == "ASK {}"
    assert desk.tab.pages.currentIndex() == 2


def test_branches_stay_expanded_when_the_scene_is_read_again(desk: Desk) -> None:
    box = desk.add()
    part = desk.add(parent=box, etype="skiros:Part")
    desk.select(part)
    tree, model = desk.tab.tree, desk.tab.model
    tree.setExpanded(model.index_of(box), True)
    element = Element("cora:Robot")  # it comes above the box
    element.addRelation(ROOT, "skiros:contain", "-1")
    desk.other.add_element(element)
    desk.window.publish(WorldChanged((), True, True))
    assert tree.isExpanded(model.index_of(ROOT)) and tree.isExpanded(model.index_of(box))
    assert model.element(tree.currentIndex()) == desk.tab.presenter.selected == part
