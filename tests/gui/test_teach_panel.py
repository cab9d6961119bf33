"""The page "Teach" of the tab "World model"."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot
from python_qt_binding.QtCore import QPoint, Qt
from python_qt_binding.QtTest import QTest

from skiros2_gui.app.widgets.main_widget import MainWidget
from support.window.driver import Driver
from support.window.local_system import LocalSystem
from support.window.teach_cell import TeachCell, taught


@pytest.fixture
def window(qtbot: QtBot) -> Iterator[MainWidget]:
    made = MainWidget(LocalSystem)
    qtbot.addWidget(made, before_close_func=MainWidget.shut_down)
    made.resize(1280, 800)
    made.show()
    yield made


@pytest.fixture
def cell(window: MainWidget) -> TeachCell:
    return TeachCell(window.shared)


@pytest.fixture
def driver(window: MainWidget, cell: TeachCell) -> Driver:
    made = Driver(window)
    made.open_tab("World model")
    made.open_tab("Teach")
    made.choose("sceneTree", "block")
    made.wait_until(lambda: made.widget("teachOwner").text() == "Taught of block", "the object")
    made.wait_until(lambda: made.widget("teach_release").isEnabled(), "the robot's skills")
    return made


def tip(driver: Driver, name: str) -> str:
    """Why a button is disabled."""
    button = driver.widget(name)
    assert not button.isEnabled()
    return button.toolTip()


def wait_for_tip(driver: Driver, name: str, text: str) -> None:
    driver.wait_until(lambda: driver.widget(name).toolTip() == text and not driver.widget(name).isEnabled(), text)


def recorded_pose(driver: Driver, name: str) -> None:
    driver.write("teachName", name)
    driver.click("teach_record_pose")
    driver.wait_for_row("taughtList", name, "pose at 100, 0, 250 mm")


def test_taught_elements_of_the_selected_object_are_listed(cell: TeachCell, driver: Driver) -> None:
    pose = cell.teach("grasp")
    cell.teach("grasp lifting", "skiros:LiftingPose", pose.id)
    cell.teach("insert", "skiros:TaughtPath", PathSamples="[[0.0, 0, 0, 0, 0, 0, 0, 1]]", GripperEvents="[]")
    cell.teach("elsewhere", owner=cell.arm.id)
    driver.wait_for_row("taughtList", "insert", "path of 0.0 s, 1 samples, gripper events: 0")
    assert driver.rows("taughtList") == [
        "grasp  pose at 100, 0, 250 mm, with a lifting pose",
        "insert  path of 0.0 s, 1 samples, gripper events: 0",
    ]


def test_selected_taught_element_shows_its_object_and_is_chosen(cell: TeachCell, driver: Driver) -> None:
    cell.teach("grasp")
    cell.teach("place")
    driver.choose("sceneTree", "place")
    driver.wait_until(lambda: driver.widget("taughtList").chosen(), "the choice")
    assert driver.widget("taughtList").chosen()[0].name == "place"
    assert driver.widget("teachOwner").text() == "Taught of block"


def test_pose_is_recorded_and_undone_with_the_windows_undo(cell: TeachCell, driver: Driver) -> None:
    recorded_pose(driver, "grasp")
    driver.wait_until(lambda: driver.widget("undoButton").toolTip() == "Undo: record grasp (Ctrl+Z)", "the undo")
    driver.click("undoButton")
    driver.wait_until(lambda: not driver.rows("taughtList"), "no pose")
    driver.click("redoButton")
    driver.wait_for_row("taughtList", "grasp")


def test_changes_of_taught_elements_by_others_cannot_be_undone(cell: TeachCell, driver: Driver) -> None:
    cell.manager._wm.add_element(taught("skiros:TaughtPose", "other", cell.block.id))
    driver.wait_for_row("taughtList", "other")
    assert "other" not in driver.widget("undoButton").toolTip()


def test_path_is_recorded_until_it_is_stored(cell: TeachCell, driver: Driver) -> None:
    driver.click("teach_release")
    driver.wait_until(lambda: "arm is guided by hand" in driver.widget("teachStatus").text(), "the state")
    driver.write("teachName", "insert")
    driver.click("teach_record_path")
    driver.wait_until(lambda: "Recording: 3.2 s" in driver.widget("teachStatus").text(), "the recording")
    wait_for_tip(driver, "teach_record_path", "/robot is running TeachPath")
    driver.click("teach_store_path")
    driver.wait_for_row("taughtList", "insert", "path of 5.2 s, 2 samples, gripper events: 1")
    wait_for_tip(driver, "teach_store_path", "No path is being recorded")
    driver.click("teach_hold")
    wait_for_tip(driver, "teach_hold", "arm is not released")


def test_lifting_pose_belongs_to_the_chosen_pose(cell: TeachCell, driver: Driver) -> None:
    assert tip(driver, "teach_record_lifting") == "Choose a taught pose"
    recorded_pose(driver, "grasp")
    driver.choose("taughtList", "grasp")
    driver.click("teach_record_lifting")
    driver.wait_for_row("taughtList", "grasp", "with a lifting pose")


def test_motion_starts_for_the_chosen_element_and_not_while_the_arm_is_released(
    cell: TeachCell, driver: Driver, window: MainWidget
) -> None:
    cell.teach("grasp")
    driver.wait_for_row("taughtList", "grasp")
    driver.choose("taughtList", "grasp")
    driver.click("teach_release")
    wait_for_tip(driver, "teach_move_to_pose", "arm is released; hold it first")
    driver.click("teach_hold")
    driver.click("teach_move_to_pose")
    wait_for_tip(driver, "teach_release", "arm is moving")
    run = window.shared.tasks.newest()
    assert run is not None and run.latest.shape.type(1) == "skiros:MoveToTaughtPose"


def test_path_is_replayed(cell: TeachCell, driver: Driver, window: MainWidget) -> None:
    cell.teach("insert", "skiros:TaughtPath")
    driver.wait_for_row("taughtList", "insert", "path without readable samples")
    driver.choose("taughtList", "insert")
    driver.click("teach_replay_path")
    driver.wait_until(lambda: window.shared.tasks.newest() is not None, "the task")
    assert window.shared.tasks.newest().latest.shape.type(1) == "skiros:ReplayTaughtPath"


def test_element_is_renamed_in_the_list(cell: TeachCell, driver: Driver, qtbot: QtBot) -> None:
    cell.teach("grasp")
    cell.teach("place")
    driver.wait_for_row("taughtList", "grasp")
    driver.choose("taughtList", "grasp")
    driver.click("teach_rename")
    editor = driver.widget("taughtList").indexWidget(driver.widget("taughtList").currentIndex())
    editor = editor or driver.widget("taughtList").viewport().focusWidget()
    QTest.keyClick(editor, Qt.Key_A, Qt.ControlModifier)
    QTest.keyClicks(editor, "pick")
    QTest.keyClick(editor, Qt.Key_Return)
    driver.wait_for_row("taughtList", "pick")
    driver.click("undoButton")
    driver.wait_for_row("taughtList", "grasp")


@pytest.mark.parametrize(
    ("name", "problem"), [("place", "the object has a taught pose or path place already"), ("  ", "the name is empty")]
)
def test_name_that_cannot_be_used_is_refused(
    cell: TeachCell, driver: Driver, window: MainWidget, name: str, problem: str
) -> None:
    cell.teach("grasp")
    cell.teach("place")
    driver.wait_for_row("taughtList", "grasp")
    model = driver.widget("taughtList").model()
    model.setData(model.index(0, 0), name)
    assert window.error_bar.text.text().endswith(problem)
    assert driver.rows("taughtList")[0].startswith("grasp")


def test_element_is_deleted_and_undo_restores_it_with_its_lifting_pose(cell: TeachCell, driver: Driver) -> None:
    pose = cell.teach("grasp")
    cell.teach("grasp lifting", "skiros:LiftingPose", pose.id)
    driver.wait_for_row("taughtList", "grasp", "with a lifting pose")
    driver.choose("taughtList", "grasp")
    driver.click("teach_delete")
    driver.wait_until(lambda: not driver.rows("taughtList"), "no pose")
    driver.click("undoButton")
    driver.wait_for_row("taughtList", "grasp", "with a lifting pose")


def test_disabled_buttons_say_why(cell: TeachCell, driver: Driver, window: MainWidget) -> None:
    assert tip(driver, "teach_record_pose") == "Enter a name"
    assert tip(driver, "teach_hold") == "arm is not released"
    assert tip(driver, "teach_rename") == "Choose a taught pose or path"
    cell.teach("insert", "skiros:TaughtPath")
    driver.wait_for_row("taughtList", "insert")
    driver.write("teachName", "insert")
    wait_for_tip(driver, "teach_record_pose", "block has a taught path insert")
    assert driver.widget("teach_record_path").text() == "Replace path"
    window.system.set_stop("/robot", "protective_stop", "collision")
    wait_for_tip(driver, "teach_release", "/robot is stopped: protective stop")
    window.system.remove_manager("/robot")
    wait_for_tip(driver, "teach_release", "/robot is not running")


def test_robot_without_the_skills_says_so(cell: TeachCell, driver: Driver, window: MainWidget) -> None:
    window.system.remove_manager("/robot")
    window.system.add_manager("/robot", [], "skiros:robot")
    wait_for_tip(driver, "teach_release", "/robot does not offer the skill TeachRelease; add it to its skill list")


def drag(driver: Driver, right: float, up: float, modifier: Qt.KeyboardModifier = Qt.NoModifier) -> None:
    """Drags the pad by shares of its radius, and holds it."""
    pad = driver.widget("forcePad")
    radius = min(pad.width(), pad.height()) / 2 - 3
    centre = pad.rect().center()
    QTest.mousePress(pad, Qt.LeftButton, modifier, centre + QPoint(round(right * radius), round(-up * radius)))


def test_drag_pushes_the_tool_until_it_is_released(cell: TeachCell, driver: Driver) -> None:
    driver.wait_until(lambda: driver.widget("forcePad").isEnabled(), "the pad")
    drag(driver, 0.0, 2.0)
    driver.wait_until(lambda: len(cell.simulator.pushes) >= 3, "the forces")
    assert {(eid, force) for eid, force, _ in cell.simulator.pushes} == {(cell.gripper.id, (15.0, 0.0, 0.0))}
    QTest.mouseRelease(driver.widget("forcePad"), Qt.LeftButton)
    assert driver.widget("forcePad").force == (0.0, 0.0, 0.0)


def test_drag_with_shift_pushes_along_z_up_to_the_limit(cell: TeachCell, driver: Driver) -> None:
    driver.wait_until(lambda: driver.widget("forcePad").isEnabled(), "the pad")
    driver.widget("forceLimit").setValue(40.0)
    drag(driver, 0.0, -1.5, Qt.ShiftModifier)
    driver.wait_until(lambda: cell.simulator.pushes, "the force")
    assert cell.simulator.pushes[0][1] == (0.0, 0.0, -40.0)


def test_pad_is_disabled_without_a_simulator(cell: TeachCell, driver: Driver) -> None:
    cell.simulator.is_running = False
    pad = driver.widget("forcePad")
    driver.wait_until(lambda: not pad.isEnabled(), "the disabled pad")
    assert pad.toolTip() == "No simulator runs: a real arm is guided by hand"
