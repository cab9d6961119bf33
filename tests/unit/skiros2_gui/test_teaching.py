"""The presenter of the page "Teach"."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from skiros2_gui.app.events import ElementSelected
from skiros2_gui.app.window import Window
from skiros2_gui.teach.presenter import Action, TeachPresenter
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_live.core.patch import TaskProgress
from support.window.teach_cell import TeachCell


@pytest.fixture
def cell(window: Window) -> TeachCell:
    return TeachCell(window)


@pytest.fixture
def world(window: Window, cell: TeachCell) -> WorldPresenter:
    made = WorldPresenter(window)
    window.process_events()
    window.publish(ElementSelected(cell.block.id))
    return made


@pytest.fixture
def teach(world: WorldPresenter) -> TeachPresenter:
    made = TeachPresenter(world, lambda: None)
    made.refresh()
    return made


def until(condition: Callable[[], object]) -> None:
    end = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_arms_have_their_robot_manager_and_gripper(cell: TeachCell, teach: TeachPresenter) -> None:
    (arm,) = teach.arms
    assert (arm.eid, arm.robot, arm.manager, arm.tool) == (cell.arm.id, "skiros:robot", "/robot", cell.gripper.id)


def test_recording_can_be_undone_whenever_the_messages_arrive(
    window: Window, cell: TeachCell, world: WorldPresenter, teach: TeachPresenter
) -> None:
    """The change of the scene is received before the first progress of the task."""
    teach.name = "grasp"
    assert teach.obstacle(Action.RECORD_POSE) == ""
    teach.do(Action.RECORD_POSE)
    until(lambda: not cell.manager.read_tasks())
    events = window._event_queue.take()
    for event in sorted(events, key=lambda event: isinstance(event, TaskProgress)):
        window.publish(event)
    assert world.undo_stack.undo_text == "record grasp"
    world.undo()
    teach.refresh()
    assert teach.taught == []


def test_replaced_pose_is_requested_as_such(window: Window, cell: TeachCell, teach: TeachPresenter) -> None:
    cell.teach("grasp")
    window.process_events()
    teach.refresh()
    teach.name = "grasp"
    assert teach.obstacle(Action.RECORD_POSE) == ""
    assert teach.obstacle(Action.RECORD_PATH) == "block has a taught pose grasp"


def test_object_that_was_removed_is_no_longer_taught(window: Window, cell: TeachCell, teach: TeachPresenter) -> None:
    cell.wm.remove_element(cell.block)
    window.process_events()
    teach.refresh()
    teach.name = "grasp"
    assert teach.owner is None
    assert teach.obstacle(Action.RECORD_POSE).startswith("Select the object")


def test_force_goes_to_the_gripper_of_the_chosen_arm(cell: TeachCell, teach: TeachPresenter) -> None:
    teach.push((1.0, 2.0, 3.0), 0.1)
    assert cell.simulator.pushes == [], "the simulator is not known yet"
    teach.ask_simulator()
    teach.push((1.0, 2.0, 3.0), 0.1)
    assert cell.simulator.pushes == [(cell.gripper.id, (1.0, 2.0, 3.0), 0.1)]


def test_arm_that_is_teleoperated_is_recorded_and_held(
    window: Window, cell: TeachCell, world: WorldPresenter, teach: TeachPresenter
) -> None:
    def status() -> str:
        window.process_events()
        teach.refresh()
        return teach.status

    assert teach.obstacle(Action.TELEOPERATE) == ""
    teach.do(Action.TELEOPERATE)
    until(lambda: "arm is moved by twists" in status())
    assert teach.obstacle(Action.RELEASE) == "arm is teleoperated; hold it first"
    assert teach.obstacle(Action.TELEOPERATE) == "arm is teleoperated; hold it first"
    teach.name = "wipe"
    teach.do(Action.RECORD_PATH)
    until(lambda: "samples" in status())
    teach.do(Action.STORE_PATH)
    until(lambda: "arm is moved by twists" in status())
    assert teach.is_teleoperated
    teach.do(Action.HOLD)
    until(lambda: status() and not teach.is_teleoperated)
