"""The window teaches an arm of the simulator: release, force, recording, undo."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from skiros2_common.core.world_element import Element
from skiros2_gui.app.events import ElementSelected
from skiros2_gui.app.ros.system import RosSystem
from skiros2_gui.app.window import Window
from skiros2_gui.teach.presenter import Action, TeachPresenter
from skiros2_gui.world.presenter import WorldPresenter
from skiros2_sim_msgs.srv import GetPose
from support.ros import Ros, wait_until
from support.teaching_cell import GRIPPER
from support.window.synchronous import make_window

pytestmark = pytest.mark.timeout(180)

WAIT = 60.0  # s


@pytest.fixture
def window(ros: Ros) -> Iterator[Window]:
    ros.launch("skiros2_teaching", "teaching.launch", gui=False)
    made = make_window(RosSystem)
    yield made
    made.system.close()


@pytest.mark.long
def test_window_teaches_a_path_by_a_force_and_undoes_it(ros: Ros, window: Window) -> None:
    world = WorldPresenter(window)
    teach = TeachPresenter(world, lambda: None)

    def until(condition: Callable[[], Any], what: str) -> Any:
        def look() -> Any:
            window.process_events()
            teach.refresh()
            return condition()

        return wait_until(look, WAIT, what)

    def do(action: Action) -> None:
        until(lambda: not teach.obstacle(action), f"the end of: {teach.obstacle(action)}")
        teach.do(action)

    until(lambda: world.hierarchy is not None and teach.arm is not None, "the scene")
    block = next(e for e in window.system.scene.matching(Element("skiros:Part"), "scene"))
    window.publish(ElementSelected(block.id))
    do(Action.RELEASE)
    until(lambda: teach.status.endswith("is guided by hand"), "the released arm")
    teach.name = "insert"
    do(Action.RECORD_PATH)
    until(lambda: "samples" in teach.status, "the recording")

    def is_simulated() -> bool:
        teach.ask_simulator()
        return not teach.push_problem

    until(is_simulated, "the simulator")
    get_pose = ros.service("/sim/get_pose", GetPose)

    def tool_x() -> float:
        return float(get_pose(GRIPPER, "").pose.pose.position.x)

    def pushed() -> bool:
        teach.push((-4.0, 0.0, 0.0), 0.1)
        assert not teach.push_problem
        return tool_x() < start - 0.03

    start = tool_x()
    until(pushed, "the pushed tool")
    do(Action.STORE_PATH)
    (path,) = until(lambda: teach.taught, "the path")
    samples = json.loads(window.system.scene.find(path.eid, "scene").value_of("skiros:PathSamples"))
    assert math.dist(samples[-1][1:4], samples[0][1:4]) > 0.005
    until(lambda: world.undo_stack.undo_text == "record insert", "the undo")
    do(Action.HOLD)
    until(lambda: not teach.is_released, "the held arm")
    world.undo()
    until(lambda: not teach.taught, "the end of the path")
