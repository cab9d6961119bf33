"""Elements of a scene in rviz: markers, dragging and drawing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rospy
from visualization_msgs.msg import (
    InteractiveMarkerFeedback,
    InteractiveMarkerInit,
    InteractiveMarkerUpdate,
    Marker,
    MarkerArray,
)

from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.ros.world_model_interface import WorldModelInterface
from support.ros import ROOT, Ros, wait_until
from support.window.display import Display

CELL = ROOT / "skiros2_std_lib/demos/pick_and_place/owl"
PRODUCT = "skiros:Product-14"
TRAY = "demo:Tray-10"

#: Part of a picture.
SOMETHING_DRAWN = 0.02


@pytest.fixture
def world(ros: Ros) -> Iterator[WorldModelInterface]:
    ros.launch("skiros2", "world_model_server.launch", gui=False, workspace_dir=str(CELL), init_scene="sim_scene.ttl")
    yield WorldModelInterface("tests")


class Drag:
    """A view's part of a drag of the selected element."""

    def __init__(self, ros: Ros) -> None:
        self.full = ros.messages("/skiros/selected/update_full", InteractiveMarkerInit)
        self._signs = ros.messages("/skiros/selected/update", InteractiveMarkerUpdate)
        self._feedback = rospy.Publisher("/skiros/selected/feedback", InteractiveMarkerFeedback, queue_size=100)

    def marker(self, eid: str, x: float | None = None) -> InteractiveMarkerInit:
        """The marker of an element, when it is there, and at `x`."""

        def found(message: InteractiveMarkerInit) -> bool:
            return any(
                m.name.startswith(f"{eid} ") and (x is None or abs(m.pose.position.x - x) < 1e-9)
                for m in message.markers
            )

        return self.full.wait_for(found).markers[0]

    def send(self, marker: InteractiveMarkerInit, event: int, x: float) -> None:
        wait_until(self._feedback.get_num_connections, what="a server of the marker")
        message = InteractiveMarkerFeedback(client_id="tests", marker_name=marker.name, event_type=event)
        message.header.frame_id = marker.header.frame_id
        message.pose.position.x = x
        message.pose.position.z = marker.pose.position.z
        message.pose.orientation.w = 1.0
        self._feedback.publish(message)

    def over(self, marker: InteractiveMarkerInit, path: list[float]) -> None:
        """From where the mouse is pressed along the path to where it is let go."""
        # A marker's server takes no feedback in the first second; it gives signs of life twice in it.
        self._signs.clear()
        wait_until(lambda: len(self._signs.all) > 2, what="three signs of life")
        self.send(marker, InteractiveMarkerFeedback.MOUSE_DOWN, marker.pose.position.x)
        for x in path:
            self.send(marker, InteractiveMarkerFeedback.POSE_UPDATE, x)
        self.send(marker, InteractiveMarkerFeedback.MOUSE_UP, path[-1])

    def close(self) -> None:
        self._feedback.unregister()


@pytest.fixture
def drag(ros: Ros, world: WorldModelInterface) -> Iterator[Drag]:
    ros.run("skiros2_gui", "markers_node", name="markers", params={"selected": PRODUCT})
    drag = Drag(ros)
    yield drag
    drag.close()


def x_of(world: WorldModelInterface, eid: str) -> float:
    pose = space.pose_of(world.get_element(eid))
    assert pose is not None
    return pose.position[0]


def test_subscriber_receives_all_markers_and_then_changes(ros: Ros, world: WorldModelInterface) -> None:
    ros.run("skiros2_gui", "markers_node", name="markers")
    early = ros.messages("/skiros/markers", MarkerArray)
    received = early.wait_for(lambda m: {"Product A", "Tray B"} <= {marker.text for marker in m.markers})
    boxes = {m.id: m for m in received.markers if m.type == Marker.CUBE}
    assert boxes[14].header.frame_id == TRAY and boxes[14].scale.x == 0.05
    early.clear()

    moved = world.get_element(PRODUCT)
    space.set_pose(moved, Pose((0.02, 0.01, 0.035), (0.0, 0.0, 0.0, 1.0)))
    world.update_element(moved)
    received = early.wait_for(lambda m: m.markers[0].pose.position.x == 0.02)  # labels may have been placed before
    assert {(m.ns, m.id) for m in received.markers} == {("skiros:Product", 14), ("skiros:Product (names)", 14)}
    world.remove_element(moved)
    early.wait_for(lambda m: [marker.action for marker in m.markers] == [Marker.DELETE] * 2)
    early.close()
    late = ros.messages("/skiros/markers", MarkerArray)
    texts = {marker.text for marker in late.wait_for().markers}
    assert "Tray B" in texts and "Product A" not in texts

    ros.kill_node("/wm")  # it is started again, with its scene from the journal
    added = Element("skiros:Product", "Later")
    space.set_pose(added, Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    space.set_text(added, space.BASE_FRAME, "map")
    added.addRelation("skiros:Scene-0", "skiros:contain", "-1")
    world.add_element(added)
    late.wait_for(lambda m: "Later" in {marker.text for marker in m.markers})


@pytest.mark.long
def test_dragged_marker_moves_the_element(world: WorldModelInterface, drag: Drag) -> None:
    path = [step / 100 for step in range(1, 31)]
    drag.over(drag.marker(PRODUCT), path)
    wait_until(lambda: x_of(world, PRODUCT) == 0.3, what="the product where it was dragged to")
    writes = [entry for entry in world.history(PRODUCT) if entry.author == "/markers"]
    assert 1 <= len(writes) < len(path) / 2, "not each move of the mouse is written"
    assert drag.marker(PRODUCT, 0.3).header.frame_id == TRAY


@pytest.mark.long
def test_rviz_starts_with_the_system_and_draws_elements(ros: Ros) -> None:
    with Display() as display:
        env = {**ros.master.env, **display.env}
        nodes = dict.fromkeys(("gui", "skill_mgr_on", "task_mgr_on"), False)
        ros.launch(
            "skiros2", "skiros.launch", rviz=True, workspace_dir=CELL, init_scene="sim_scene.ttl", env=env, **nodes
        )
        ros.wait_for_node("/rviz")
        wait_until(lambda: green(display) > SOMETHING_DRAWN, what="workstations drawn by rviz")


def green(display: Display) -> float:
    """The part of the picture that is green, as places are; rviz's own side panel does not count."""
    red, greens, blue = (
        channel.astype(int) for channel in np.moveaxis(np.asarray(display.grab().convert("RGB"))[:, 500:], 2, 0)
    )
    return float(np.mean((greens > red + 15) & (greens > blue + 15)))


@pytest.mark.long
def test_embedded_rviz_draws_the_selection(ros: Ros, world: WorldModelInterface, tmp_path: Path) -> None:
    with Display() as display:
        picture = tmp_path / "window.png"
        command = (sys.executable, "-m", "support.window.rviz_screenshot", "Product A", str(picture))
        env = {**ros.master.env, **display.env}
        env["PYTHONPATH"] = f"{Path(__file__).parents[1]}:{env['PYTHONPATH']}"
        program = ros.program(*command, env=env)
        assert program.wait(60.0) == 0, "it draws, and ends without a crash"
    assert picture.is_file()
