"""The window with nodes: mouse and keyboard, and restarts of parts of the system."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from python_qt_binding.QtCore import Qt
from python_qt_binding.QtWidgets import QApplication

from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import EventQueue
from skiros2_gui.app.next_step import next_step
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.system import Part, parts_of, sentence
from skiros2_gui.app.widgets.main_widget import MainWidget
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.patch import WORLD_MODEL, Connection
from skiros2_msgs.msg import TreeProgress
from skiros2_runs.core.states import SUCCESS
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support import window_monitor
from support.ros import INSTALL, Ros, RosMaster, wait_until
from support.rqt_host import RqtHost, provide_rqt
from support.window.driver import Driver
from support.window.local_system import LocalSystem

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytestmark = pytest.mark.timeout(300)

ROBOT = "/mobile_manipulator"
PRODUCT_A_IN_TRAY_B = "(skiros:contain demo:Tray-12 skiros:Product-14)"
ALL_PARTS = {"ROS master", "world model", "robot", "task manager"}


@pytest.fixture(scope="module")
def demo(ros_master: RosMaster) -> Iterator[Ros]:
    """The demo whose motions only take time; one for all tests of this file."""
    ros = Ros(ros_master)
    ros.launch("skiros2_demo_skills", "demo.launch", gui=False)
    yield ros
    ros.stop()


@pytest.fixture(scope="module")
def shown(demo: Ros, qapp: QApplication) -> Iterator[Driver]:
    content = MainWidget(RosSystem)
    content.resize(1280, 800)
    content.show()
    driver = Driver(content)
    driver.wait_until(lambda: up(driver) == ALL_PARTS, "the whole system")
    yield driver
    content.shut_down()
    content.close()


@pytest.fixture
def window(shown: Driver) -> Iterator[Driver]:
    """The window; at the end of the test it has shown no errors."""
    yield shown
    problems = shown.window.shared.problems
    assert [problem.line for problem in problems.history] == []
    problems.clear()


def up(driver: Driver) -> set[str]:
    """The kinds of parts that the window has."""
    return {part.kind for part in parts_of(driver.window.shared.tasks.cell) if part.is_up}


def test_skill_is_started_and_stopped_by_clicks(window: Driver, demo: Ros) -> None:
    told = demo.messages(f"{ROBOT}/monitor", TreeProgress)
    window.open_tab("Skills")
    window.choose("skillTree", "wait")
    window.write("param_Duration", "60")
    window.click("startButton")
    window.wait_for_row("taskList", "wait", "running", "Waiting: ")
    window.open_tab("Running")
    window.open_tab("Messages")
    window.wait_for_row("messages", "Waiting: ")
    window.click("stopButton")
    window.wait_for_row("messages", "Stopped while waiting")
    root = told.wait_for(lambda message: abs(message.progress[0].progress_code) == 1).progress[0]
    assert root.type == ":Root"
    window.open_tab("Skills")
    window.wait_for_row("taskList", "wait", "preempted")


def test_button_of_approvals_is_there_while_the_master_knows_a_gateway(window: Driver, demo: Ros) -> None:
    button = window.window.approvals
    assert not button.isVisible()
    demo.master.set_parameter("/gateway/address", "http://127.0.0.1:9")
    window.wait_until(button.isVisible, "the button")
    window.click("approvalsButton")
    assert window.widget("gateway").text() == "http://127.0.0.1:9"
    window.write("secret", "a token")
    window.click("logIn")
    window.wait_until(lambda: "cannot be reached" in window.widget("approvalNote").text(), "the reason")
    button.dialog.close()
    demo.master.delete_parameter("/gateway/address")
    window.wait_until(lambda: not button.isVisible(), "no button")


def test_refused_start_is_explained_before_and_after(window: Driver) -> None:
    window.open_tab("Skills")
    window.choose("skillTree", "pick")
    window.choose("param_Object", "Product A")
    why_not = window.widget("whyNot")
    refused = "It would be refused: no element of the scene matches Workstation."
    window.wait_until(lambda: why_not.text() == refused, "why")
    window.click("whyNotMore")
    details = window.widget("whyNotDetails").toPlainText()
    assert "mobile_manipulator is at" in details and "skiros:" not in details
    window.click("startButton")
    window.wait_for_row("taskList", "pick", "failed")
    why = window.widget("taskWhy")
    window.wait_until(lambda: "Workstation" in why.toPlainText(), "why it failed")


def test_goal_is_achieved_from_the_goal_line(window: Driver) -> None:
    window.open_tab("Skills")
    window.write("goalLine", PRODUCT_A_IN_TRAY_B)
    window.click("planButton")
    window.wait_for_row("planView", "place", "Tray B")
    window.click("achieveButton")
    window.wait_for_row("planView", "place", "succeeded")
    assert WorldModelInterface("/test_window").get_element("skiros:Product-14").getRelations("demo:Tray-12")
    window.open_tab("Running")
    window.wait_for_row("taskChoice", "Tray B contains Product A", "succeeded")
    assert not any("place" in row for row in window.rows("taskChoice")), "the steps are in the tree of the goal"
    goal = window.window.shared.tasks.rows[0].latest
    assert [goal.shape.name(index) for index in goal.shape.children[0]] == ["drive", "pick", "drive", "place"]
    assert goal.state(0) == SUCCESS and not goal.running() and not goal.failed()


def test_edit_changes_the_world_model(window: Driver) -> None:
    wmi = WorldModelInterface("/test_window")
    window.open_tab("World model")
    window.choose("sceneTree", "Product C")
    window.wait_until(lambda: window.widget("elementLabel").text() == "Product C", "the element")
    window.write("elementLabel", "Spare part", Qt.Key_Return)
    window.wait_until(lambda: wmi.get_element("skiros:Product-16").label == "Spare part", "the new label")
    window.click("undoButton")
    window.wait_until(lambda: wmi.get_element("skiros:Product-16").label == "Product C", "the old label")
    theirs = wmi.get_element("skiros:Product-16")
    theirs.label = "Renamed by others"
    wmi.update_element(theirs)
    window.wait_for_row("sceneTree", "Renamed by others")


@pytest.mark.parametrize(("node", "kind"), [("/wm", "world model"), (ROBOT, "robot"), ("/tm", "task manager")])
def test_killed_part_is_reported_and_found_again(window: Driver, demo: Ros, node: str, kind: str) -> None:
    def part() -> Part:
        return next(part for part in parts_of(window.window.shared.tasks.cell) if part.kind == kind)

    label = next(label for label in window.window.status.parts if kind in label.text())
    window.wait_until(lambda: label.text().startswith("●"), f"the {kind} being shown")
    since = part().since
    demo.kill_node(node)  # roslaunch starts it again, which may take less time than the window needs to miss it
    window.wait_until(lambda: part().since > since, f"the {kind} being missed")
    window.wait_until(lambda: up(window) == ALL_PARTS, f"the {kind} being there again")
    window.wait_until(lambda: label.toolTip() == sentence(part()), "since when it is there")
    assert label.text().startswith("●")


@pytest.mark.long
def test_killed_master_is_reported_and_its_successor_found(tmp_path: Path) -> None:
    with RosMaster(tmp_path) as master:
        ros = Ros(master)
        try:
            ros.run("skiros2_world_model", "world_model_server_node", name="wm")
            onlooker = ros.program(sys.executable, window_monitor.__file__)
            onlooker.wait_for_line("^● ROS master.*● world model")
            master.kill()
            onlooker.wait_for_line("^✕ ROS master.*has been missing since")
            master.start()
            again = re.compile(r"^✕ ROS master.*^● ROS master[^\n]*● world model", re.DOTALL | re.MULTILINE)
            wait_until(lambda: again.search(onlooker.output), what="the new master in the window")
        finally:
            ros.stop()


def test_two_instances_in_one_rqt_are_independent(
    demo: Ros, shown: Driver, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    provide_rqt(monkeypatch)
    rqt = RqtHost(INSTALL / "share/skiros2_gui/package.xml", tmp_path / "rqt_gui.ini")
    first, second = rqt.load("gui.skiros", 1), rqt.load("gui.skiros", 2)
    try:
        for instance in (first, second):
            driver = Driver(instance.widget)
            driver.wait_until(lambda driver=driver: up(driver) == ALL_PARTS, "the whole system")
        first.close()
        driver.open_tab("World model")
        driver.wait_for_row("sceneTree", "Charging station")
        wmi = WorldModelInterface("/test_window")
        place = wmi.get_element("skiros:Location-5")
        place.label = "Renamed for the second"
        wmi.update_element(place)
        driver.wait_for_row("sceneTree", "Renamed for the second")
        driver.open_tab("Skills")
        driver.choose("skillTree", "wait")
        driver.write("param_Duration", "0.1")
        driver.click("startButton")
        driver.wait_for_row("taskList", "wait", "succeeded")
    finally:
        first.close()
        second.close()


def test_command_of_the_next_step_starts_a_skill_manager(window: Driver, demo: Ros) -> None:
    robot = Element("cora:Robot", "skiros:second_robot")
    robot.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    WorldModelInterface("/test_window").add_element(robot)
    system = LocalSystem(EventQueue(lambda: None))
    system.world.add_element(robot.copy())
    cell = CellDocument()
    cell.apply(Connection(WORLD_MODEL, "/wm", True, 1.0))
    step = next_step(system, cell)
    assert step is not None and step.command
    demo.program(*step.command.split())
    window.wait_until(lambda: "/second_robot" in window.window.system.managers, "the second robot")
    window.open_tab("Skills")
    window.wait_for_row("skillTree", "second_robot")


def test_standalone_window_ends_with_its_node(ros: Ros) -> None:
    env = {**ros.master.env, "QT_QPA_PLATFORM": "offscreen"}
    program = ros.run("skiros2_gui", "skiros_gui", name="a_window", env=env)
    ros.wait_for_node("/a_window")
    ros.program("rosnode", "kill", "/a_window").wait()
    assert program.wait() == 0
