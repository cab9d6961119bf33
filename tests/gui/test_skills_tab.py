"""The widgets of the tab "Skills", on a robot in this process."""

from __future__ import annotations

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QPoint, QPointF, QRect, Qt
from python_qt_binding.QtGui import QWheelEvent
from python_qt_binding.QtWidgets import (
    QApplication,
    QCheckBox,
    QComboBox,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QPushButton,
    QSlider,
    QTableView,
    QToolButton,
    QTreeWidget,
    QWidget,
)

from skiros2_common.core.errors import Refused
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_gui.goal.plan import GoalExecution
from skiros2_gui.skills.form import ElementChoice, Field
from skiros2_gui.skills.presenter import SkillsPresenter
from skiros2_gui.skills.widgets import editors
from skiros2_gui.skills.widgets.tab import SkillsTab
from support.window.local_system import LocalSystem
from unit.skiros2_gui.lab_skills import fetch, fetch_gently, furnish, note

FETCH = ("/robot", "skiros:Fetch", "")
NOTE = ("/robot", "skiros:Note", "note")


@pytest.fixture
def tab(qtbot: QtBot) -> Iterator[SkillsTab]:
    window = MainWidget(LocalSystem)
    qtbot.addWidget(window, before_close_func=MainWidget.shut_down)
    window.ids = furnish(window.system.world)
    window.system.add_manager("/robot", [fetch, fetch_gently, note])
    window.show()
    tab = window.pages[0].tab
    qtbot.waitUntil(lambda: bool(tab.skills.rows and tab.skills.rows[0].skills))
    yield tab


def _child(tab: SkillsTab, kind: type[QWidget], name: str) -> Any:
    found = tab.findChild(kind, name)
    assert found is not None, f"no {name}"
    return found


def _click(qtbot: QtBot, tab: SkillsTab, name: str) -> None:
    qtbot.mouseClick(_child(tab, QPushButton, name), Qt.LeftButton)


def _overwrite(qtbot: QtBot, line: QLineEdit, text: str) -> None:
    line.selectAll()
    qtbot.keyClicks(line, text)


def _states(tab: SkillsTab) -> list[str]:
    return [row.state for row in tab.skills.tasks.rows]


def test_skill_is_started_and_stopped_by_clicks(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(FETCH)
    thing = _child(tab, QComboBox, "param_Thing")
    qtbot.waitUntil(lambda: thing.currentText() == "infer: bolt")
    start = _child(tab, QPushButton, "startButton")
    assert not start.isEnabled()
    assert "Times: a whole number is needed" in tab.form.why_not.text()
    qtbot.keyClicks(_child(tab, QLineEdit, "param_Times"), "2")
    qtbot.waitUntil(start.isEnabled)
    assert tab.form.why_not.text().startswith("Ready. The robot would use Box = box")
    qtbot.mouseClick(start, Qt.LeftButton)
    qtbot.waitUntil(lambda: _states(tab) == ["running"])
    tasks = _child(tab, QTreeWidget, "taskList")
    qtbot.waitUntil(lambda: tasks.topLevelItemCount() == 1)
    tasks.itemDoubleClicked.emit(tasks.topLevelItem(0), 0)
    assert tab.window().tab.title == "Running"
    tab.window().tabs.setCurrentIndex(0)
    pause = _child(tab, QPushButton, "pauseButton")
    qtbot.mouseClick(pause, Qt.LeftButton)
    qtbot.waitUntil(lambda: pause.text().endswith("Resume"))
    qtbot.mouseClick(pause, Qt.LeftButton)
    qtbot.waitUntil(lambda: pause.text().endswith("Pause"))
    qtbot.mouseClick(pause, Qt.LeftButton)
    qtbot.waitUntil(lambda: pause.text().endswith("Resume"))
    _click(qtbot, tab, "stepButton")
    _click(qtbot, tab, "stopButton")
    qtbot.waitUntil(lambda: _states(tab) == ["preempted"])
    qtbot.waitUntil(lambda: not _child(tab, QPushButton, "stopButton").isEnabled())


def test_typed_element_is_chosen_and_refusal_explained(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(FETCH)
    tab.skills.write("Times", "2")
    thing = _child(tab, QComboBox, "param_Thing")
    qtbot.waitUntil(lambda: thing.count() == 3)
    thing.lineEdit().selectAll()
    qtbot.keyClicks(thing.lineEdit(), "nut")
    qtbot.keyClick(thing.lineEdit(), Qt.Key_Return)
    qtbot.waitUntil(lambda: "no element of the scene matches Box" in tab.form.why_not.text())
    assert thing.currentText() == "nut"
    assert "large box in the scene" in _child(tab, QPlainTextEdit, "whyNotDetails").toPlainText()


def test_unknown_element_is_reset(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(FETCH)
    thing = _child(tab, QComboBox, "param_Thing")
    qtbot.waitUntil(lambda: thing.count() == 3)
    before = thing.currentText()
    thing.lineEdit().selectAll()
    qtbot.keyClicks(thing.lineEdit(), "no such thing")
    qtbot.keyClick(thing.lineEdit(), Qt.Key_Return)
    assert thing.currentText() == before


def test_long_list_is_filled_on_focus(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(FETCH)
    thing = _child(tab, QComboBox, "param_Thing")
    qtbot.waitUntil(lambda: thing.count() == 3)
    many = tuple(ElementChoice(f"skiros:Product-{n}", f"part {n}") for n in range(2000))
    thing.parent().show_inferred(many[7], many)
    assert (thing.count(), thing.currentText()) == (1, "infer: part 7")
    thing.setFocus()
    qtbot.waitUntil(lambda: thing.count() == 2001)


def test_wheel_over_a_combo_box_does_not_change_it(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(NOTE)
    loud = _child(tab, QComboBox, "param_Loud")
    middle = QPointF(loud.rect().center())
    QApplication.sendEvent(
        loud,
        QWheelEvent(
            middle, QPointF(loud.mapToGlobal(middle.toPoint())), QPoint(0, 0), QPoint(0, 120),
            Qt.NoButton, Qt.NoModifier, Qt.NoScrollPhase, False,
        ),
    )  # fmt: skip
    assert loud.currentText() == "no"


def test_space_starts_and_stops(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(FETCH)
    tab.skills.write("Times", "2")
    tab.tree.tree.setFocus()
    qtbot.keyClick(tab.tree.tree, Qt.Key_Space)
    qtbot.waitUntil(lambda: _states(tab) == ["running"])
    qtbot.keyClick(tab.tree.tree, Qt.Key_Space)
    qtbot.waitUntil(lambda: _states(tab) == ["preempted"])


def test_enter_in_the_search_selects_the_first_skill(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.find()
    qtbot.keyClicks(tab.tree.search, "note")
    qtbot.keyClick(tab.tree.search, Qt.Key_Return)
    assert tab.skills.form.offer.key == NOTE


def test_invalid_json_is_reported_while_typing(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(NOTE)
    marks = _child(tab, QPlainTextEdit, "param_Marks")
    marks.setPlainText("[1,")
    assert "this is not JSON" in tab.form.why_not.text()
    marks.setPlainText("")
    assert "Marks" not in tab.form.why_not.text()


def test_form_shows_docstring_hints_and_defaults(tab: SkillsTab) -> None:
    tab.tree.choose(FETCH)
    assert tab.form.purpose.text() == "Brings a product to the robot."
    assert _child(tab, QLabel, "hint_Speed").text() == "How fast · 0.1 to 2 m/s · default 0.5"
    assert _child(tab, QLabel, "hint_Thing").text() == "What to fetch"
    tab.tree.choose(NOTE)
    assert not tab.form.purpose.isVisible()


def test_values_of_earlier_starts_are_offered_first(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(FETCH)
    thing = _child(tab, QComboBox, "param_Thing")
    qtbot.waitUntil(lambda: [thing.itemText(i) for i in range(3)] == ["infer: bolt", "bolt", "nut"])
    assert not _child(tab, QToolButton, "recent_Times").isVisible()
    tab.skills.recent.restore({"skiros:Fetch": {"Thing": [tab.window().ids["nut"], "skiros:Gone-9"]}})
    _overwrite(qtbot, _child(tab, QLineEdit, "param_Times"), "2")
    _click(qtbot, tab, "startButton")
    recent = _child(tab, QToolButton, "recent_Times")
    qtbot.waitUntil(recent.isVisible)
    qtbot.waitUntil(lambda: [thing.itemText(i) for i in range(3)] == ["infer: bolt", "nut", "bolt"])
    _overwrite(qtbot, _child(tab, QLineEdit, "param_Times"), "7")
    recent.menu().actions()[0].trigger()
    assert _child(tab, QLineEdit, "param_Times").text() == tab.skills.form.fields["Times"].text == "2"


def test_reason_of_a_failure_is_shown_below_the_list(tab: SkillsTab, qtbot: QtBot) -> None:
    tab.tree.choose(NOTE)
    qtbot.keyClicks(_child(tab, QLineEdit, "param_Text"), "hello")
    loud = _child(tab, QComboBox, "param_Loud")
    loud.setFocus()
    qtbot.keyClick(loud, Qt.Key_Up)
    _click(qtbot, tab, "startButton")
    qtbot.waitUntil(lambda: "too loud" in _child(tab, QPlainTextEdit, "taskWhy").toPlainText())
    qtbot.waitUntil(lambda: tab.tasks.list.topLevelItem(0).text(1) == "✗ failed")


def test_settings_are_restored_and_invalid_ones_skipped(tab: SkillsTab) -> None:
    tab.goals.write("(skiros:contain box nut)")
    kept = tab.settings()
    tab.goals.write("")
    tab.restore({"goals": 3, "goal": [], "across": 3, "down": "ä", "more": None})
    assert tab.goals.text == ""
    tab.restore(kept)
    assert tab.goals.text == "(skiros:contain box nut)"


def test_registered_editor_edits_the_fields_that_it_accepts(
    tab: SkillsTab, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(editors, "_editors", list(editors._editors))

    @editors.register_editor
    class SpeedSlider(editors.FieldEditor):
        @classmethod
        def accepts(cls, field: Field) -> bool:
            return field.limits.unit == "m/s"

        def __init__(self, field: Field, skills: SkillsPresenter) -> None:
            self.slider = QSlider(Qt.Horizontal)
            super().__init__(field, skills, self.slider)
            self.slider.valueChanged.connect(lambda value: skills.write(field.key, str(value / 10)))

    tab.tree.choose(FETCH)
    _child(tab, QSlider, "param_Speed").setValue(12)
    assert tab.skills.form.given()["Speed"] == [1.2]


# -- the goal line -------------------------------------------------------------------------------------------------


def test_goal_line_completes_words_and_shows_errors(tab: SkillsTab, qtbot: QtBot) -> None:
    line = _child(tab, QLineEdit, "goalLine")
    tab.goals.refresh()
    qtbot.waitUntil(lambda: bool(tab.goals.completions(0).items) and bool(tab.goals.vocabulary.elements))
    line.setFocus()
    qtbot.keyClicks(line, "(skiros:contain empty")
    popup = line.popup
    qtbot.waitUntil(popup.isVisible)
    qtbot.keyClick(popup, Qt.Key_Return)
    assert line.text() == "(skiros:contain skiros:LargeBox-2 "
    line.setText("(skiros:contain box blot)")
    mistake = _child(tab, QLabel, "goalMistake")
    qtbot.waitUntil(lambda: mistake.text() == "⚠ column 21: unknown element 'blot'; did you mean bolt?")
    assert not _child(tab, QPushButton, "planButton").isEnabled()


@pytest.fixture
def goal_line(tab: SkillsTab, qtbot: QtBot) -> Any:
    """The goal line with the words of the scene, in a window that is active."""
    qtbot.waitActive(tab.window())
    tab.goals.refresh()
    qtbot.waitUntil(lambda: bool(tab.goals.vocabulary.elements))
    line = _child(tab, QLineEdit, "goalLine")
    qtbot.mouseClick(line, Qt.LeftButton)
    return line


def _type(qtbot: QtBot, line: Any, text: str) -> None:
    """Types a text; keys go to the suggestions while they are shown, as those of users do."""
    for sign in text:
        popup = line.popup
        qtbot.keyClicks(popup if popup.isVisible() else line, sign)


def _press(qtbot: QtBot, line: Any, *keys: int) -> None:
    for key in keys:
        popup = line.popup
        qtbot.keyClick(popup if popup.isVisible() else line, key)


def test_closing_bracket_hides_the_completions(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    _type(qtbot, goal_line, "(skiros:contain skiros:LargeBox-1 bolt")
    assert goal_line.popup.isVisible()
    _type(qtbot, goal_line, ")")
    assert not goal_line.popup.isVisible()
    _press(qtbot, goal_line, Qt.Key_Return)
    assert goal_line.text() == "(skiros:contain skiros:LargeBox-1 bolt)"


def test_leaving_the_word_hides_the_completions(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    goal_line.setText("(skiros:contain skiros:LargeBox-1 )")
    goal_line.setCursorPosition(34)
    _type(qtbot, goal_line, "bo")
    assert goal_line.popup.isVisible()
    _press(qtbot, goal_line, Qt.Key_End)
    assert not goal_line.popup.isVisible()
    assert goal_line.text() == "(skiros:contain skiros:LargeBox-1 bo)"


class TaskManager:
    """Remembers the goals, and refuses them."""

    def __init__(self) -> None:
        self.goals: list[str] = []

    def plan(self, goals: str) -> Any:
        self.goals.append(goals)
        raise Refused("no robot in the world model offers skills")


def test_enter_in_a_complete_goal_plans_and_inserts_nothing(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    system: Any = tab.window().system
    system.planner = TaskManager()
    goal_line.setText("(skiros:contain box )")
    goal_line.setCursorPosition(20)
    _type(qtbot, goal_line, "nut")
    assert goal_line.popup.isVisible()
    assert tab.goals.is_complete
    with qtbot.waitSignal(goal_line.returnPressed):
        _press(qtbot, goal_line, Qt.Key_Return)
    assert goal_line.text() == "(skiros:contain box nut)"
    qtbot.waitUntil(lambda: system.planner.goals == ["(skiros:contain box nut)"])


def test_enter_inserts_a_completion_selected_with_arrows(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    goal_line.setText("(skiros:contain  nut)")
    goal_line.setCursorPosition(16)
    _type(qtbot, goal_line, "box")
    assert tab.goals.is_complete
    words = [word.text for word in tab.goals.completions(19).items]
    _press(qtbot, goal_line, Qt.Key_Down, Qt.Key_Return)
    assert goal_line.text() == f"(skiros:contain {words[1]} nut)"


@pytest.mark.parametrize("key", [Qt.Key_Tab, Qt.Key_Return])
def test_completion_replaces_the_whole_word_at_the_cursor(
    tab: SkillsTab, goal_line: Any, qtbot: QtBot, key: int
) -> None:
    goal_line.setText("(skiros:contain emp, nut")
    goal_line.setCursorPosition(17)
    _type(qtbot, goal_line, "m")
    _press(qtbot, goal_line, key)
    assert goal_line.text() == "(skiros:contain skiros:LargeBox-2 , nut"
    assert goal_line.hasFocus()


def test_completions_do_not_cover_the_error_line(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    _type(qtbot, goal_line, "(skiros:contain b")
    popup, mistake = goal_line.popup, _child(tab, QLabel, "goalMistake")
    qtbot.waitUntil(mistake.isVisible)
    QApplication.processEvents()
    label = QRect(mistake.mapToGlobal(QPoint(0, 0)), mistake.size())
    assert popup.isVisible()
    assert not popup.geometry().intersects(label)


# -- the focus -----------------------------------------------------------------------------------------------------


def test_focus_stays_after_start_and_space_stops_the_task(tab: SkillsTab, qtbot: QtBot) -> None:
    qtbot.waitActive(tab.window())
    line = _child(tab, QLineEdit, "goalLine")
    line.setText("(skiros:contain box nut)")
    tab.below.setCurrentWidget(tab.goal_view)
    tab.tree.choose(FETCH)
    tab.skills.write("Times", "2")
    start = _child(tab, QPushButton, "startButton")
    qtbot.mouseClick(start, Qt.LeftButton)
    assert QApplication.focusWidget() is start
    qtbot.waitUntil(lambda: _states(tab) == ["running"])
    assert QApplication.focusWidget() is start
    assert tab.below.currentWidget() is tab.tasks
    qtbot.keyClick(QApplication.focusWidget(), Qt.Key_Space)
    qtbot.waitUntil(lambda: _states(tab) == ["preempted"])
    assert line.text() == "(skiros:contain box nut)"


def test_space_during_a_pending_start_stops_the_task(tab: SkillsTab, qtbot: QtBot) -> None:
    qtbot.waitActive(tab.window())
    tab.tree.choose(FETCH)
    tab.skills.write("Times", "2")
    start = _child(tab, QPushButton, "startButton")
    qtbot.mouseClick(start, Qt.LeftButton)
    qtbot.keyClick(start, Qt.Key_Space)
    qtbot.waitUntil(lambda: _states(tab) == ["preempted"])


# -- how goals go on -----------------------------------------------------------------------------------------------


def test_goal_execution_is_shown(tab: SkillsTab, qtbot: QtBot) -> None:
    step = {"number": 1, "skill": "skiros:Drive", "label": "drive", "robot": "/a", "start": 0.0, "end": 2.0}
    states = '[{"number": 1, "state": "running"}]'
    execution = GoalExecution("(a b)").after_feedback(
        SimpleNamespace(phase="running", message="", plan=json.dumps([step]), steps=states)
    )
    tab.goals.execution = execution
    tab.goals.on_goal()
    steps = _child(tab, QTableView, "planView")
    assert [steps.model().index(0, i).data() for i in (0, 1, 5)] == ["1", "▶ running", "drive"]
    done = json.dumps([{**step, "state": "failed", "message": "no mode"}])
    tab.goals.execution = execution.after_result(
        SimpleNamespace(state="failed", message="given up", done=done, explanations="[]")
    )
    tab.goals.on_goal()
    assert _child(tab, QLabel, "planHead").text() == "✕ given up"
    assert "1. drive: no mode" in _child(tab, QPlainTextEdit, "planWhy").toPlainText()


def test_long_cells_of_a_plan_are_wrapped(tab: SkillsTab, qtbot: QtBot) -> None:
    arguments = {f"Parameter{n}": f"a long name of an element {n}" for n in range(12)}
    step = {"number": 1, "label": "drive", "robot": "/a", "start": 0.0, "end": 2.0, "arguments": arguments}
    feedback = SimpleNamespace(phase="running", message="", plan=json.dumps([step]), steps="")
    tab.below.setCurrentWidget(tab.goal_view)
    tab.goals.execution = GoalExecution("(a b)").after_feedback(feedback)
    tab.goals.on_goal()
    steps = _child(tab, QTableView, "planView")
    qtbot.waitUntil(lambda: steps.rowHeight(0) > 3 * steps.fontMetrics().height())
    assert not steps.horizontalScrollBar().isVisible()


# -- the lines of a goal -------------------------------------------------------------------------------------------


def test_goal_is_built_from_lists(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    tab.below.setCurrentWidget(tab.goal_lines)
    _click(qtbot, tab, "addConditionButton")
    for name, text in (("goalSubject_0", "empty box"), ("goalPredicate_0", "contain"), ("goalObject_0", "bolt")):
        box = _child(tab, QComboBox, name)
        box.lineEdit().selectAll()
        qtbot.keyClicks(box.lineEdit(), text)
        qtbot.keyClick(box.lineEdit(), Qt.Key_Return)
    assert goal_line.text() == "(skiros:contain skiros:LargeBox-2 skiros:Product-3)"
    _child(tab, QCheckBox, "goalNot_0").click()
    assert goal_line.text() == "(not (skiros:contain skiros:LargeBox-2 skiros:Product-3))"


def test_lines_follow_the_text_of_the_goal(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    tab.below.setCurrentWidget(tab.goal_lines)
    goal_line.setText("(forall (?x - skiros:Product) (skiros:contain box ?x)), (> (skiros:Weight bolt) 2)")
    shown = [_child(tab, QComboBox, f"goal{box}").currentText() for box in ("Subject_0", "Object_0", "Subject_1")]
    assert shown == ["box", "every product", "bolt"]
    assert _child(tab, QLineEdit, "goalValue_1").text() == "2"
    qtbot.keyClicks(_child(tab, QLineEdit, "goalValue_1"), "5")
    assert goal_line.text().endswith("(> (skiros:Weight bolt) 25)")
    qtbot.mouseClick(_child(tab, QToolButton, "removeCondition_0"), Qt.LeftButton)
    assert goal_line.text() == "(> (skiros:Weight bolt) 25)"
    goal_line.setText("(> (skiros:Weight")
    assert not tab.goal_lines.add.isEnabled()


def test_goal_is_shown_as_a_sentence_first(tab: SkillsTab, goal_line: Any) -> None:
    assert tab.below.currentWidget() is tab.goal_lines
    goal_line.setText("(skiros:contain skiros:LargeBox-2 bolt)")
    assert _child(tab, QLabel, "goalSentence").text() == "empty box contains bolt"


def test_line_of_a_new_goal_is_there_without_a_click(tab: SkillsTab, goal_line: Any) -> None:
    assert _child(tab, QComboBox, "goalSubject_0").isVisible()
    assert goal_line.text() == ""


def test_line_of_a_new_property_has_a_value(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    tab.below.setCurrentWidget(tab.goal_lines)
    goal_line.setText("(skiros:contain box nut)")
    box = _child(tab, QComboBox, "goalPredicate_0")
    box.lineEdit().selectAll()
    qtbot.keyClicks(box.lineEdit(), "Weight")
    qtbot.keyClick(box.lineEdit(), Qt.Key_Return)
    value = _child(tab, QLineEdit, "goalValue_0")
    qtbot.waitUntil(value.isVisible)
    assert value.placeholderText() == "at least 0 kg"
    assert [label.text() for label in value.parent().findChildren(QLabel)] == ["kg"]
    assert goal_line.text() == ""
    qtbot.keyClicks(value, "2.5")
    assert goal_line.text() == "(= (skiros:Weight box) 2.5)"


def _choose(qtbot: QtBot, tab: SkillsTab, name: str, text: str) -> None:
    box = _child(tab, QComboBox, name)
    box.lineEdit().selectAll()
    qtbot.keyClicks(box.lineEdit(), text)
    qtbot.keyClick(box.lineEdit(), Qt.Key_Return)


def _entries(tab: SkillsTab, name: str) -> list[str]:
    box = _child(tab, QComboBox, name)
    return [box.itemText(row) for row in range(box.count())]


def test_boolean_is_true_or_false(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    tab.below.setCurrentWidget(tab.goal_lines)
    _choose(qtbot, tab, "goalSubject_0", "bolt")
    _choose(qtbot, tab, "goalPredicate_0", "Missing")
    assert _entries(tab, "goalValue_0") == ["true", "false"] and _entries(tab, "goalOperator_0") == ["="]
    value = _child(tab, QComboBox, "goalValue_0")
    qtbot.keyClick(value, Qt.Key_Down)
    qtbot.keyClick(value, Qt.Key_Down)
    assert goal_line.text() == "(= (skiros:Missing skiros:Product-3) false)"
    goal_line.setText("(skiros:Missing bolt)")
    assert _child(tab, QComboBox, "goalValue_0").currentText() == "true"
    goal_line.setText("(= (skiros:Missing bolt) my_robot)")
    mistake = _child(tab, QLabel, "goalMistake")
    qtbot.waitUntil(lambda: "expected = with true or false, got = my_robot" in mistake.text())
    assert not tab.goals.is_complete


def test_relation_offers_elements_in_its_range(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    tab.below.setCurrentWidget(tab.goal_lines)
    goal_line.setText("(skiros:contain box nut)")
    _choose(qtbot, tab, "goalPredicate_0", "cora:robotPart")  # from a device to a robot
    assert {"box", "nut"} & {*_entries(tab, "goalSubject_0"), *_entries(tab, "goalObject_0")} == set()
    assert "test robot" in [text.replace("_", " ") for text in _entries(tab, "goalObject_0")]
    assert [_child(tab, QComboBox, f"goal{box}_0").currentText() for box in ("Subject", "Object")] == ["", ""]
    _choose(qtbot, tab, "goalPredicate_0", "skiros:contain")
    assert {"box", "nut"} <= set(_entries(tab, "goalObject_0"))


def test_lists_are_filled_again_only_for_other_entries(tab: SkillsTab, goal_line: Any, qtbot: QtBot) -> None:
    world, box = tab.window().system.world, _child(tab, QComboBox, "goalSubject_0")
    qtbot.waitUntil(lambda: "bolt" in _entries(tab, "goalSubject_0"))
    filled = box.model()
    bolt = world.get_element("skiros:Product-3")
    bolt.setProperty("skiros:Weight", 7.0)
    goals = tab.goals
    before = goals.choices
    world.update_element_properties(bolt)
    qtbot.waitUntil(lambda: goals.choices is not before)
    assert box.model() is filled
    bolt.label = "screw"
    world.update_element(bolt)
    qtbot.waitUntil(lambda: "screw" in _entries(tab, "goalSubject_0"))
    assert "bolt" not in _entries(tab, "goalSubject_0")
