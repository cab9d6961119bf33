"""The interactive marker of the selected element."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest
from visualization_msgs.msg import InteractiveMarkerFeedback as Feedback

from skiros2_common.core.world_element import Element
from skiros2_gui.view3d.ros import selected_marker
from skiros2_gui.view3d.ros.selected_marker import SelectedMarker
from skiros2_live.core.markers import ElementMarker, MarkerFactory
from skiros2_motion.core.geometry import Pose
from skiros2_std_reasoners.core import spatial_data as space
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.wm_errors import WmException

TIMEOUT = 20.0


class Server:
    """Keeps the markers as a view sees them."""

    def __init__(self) -> None:
        self.markers: dict[str, Any] = {}
        self.feedback: Any = None
        self.put = threading.Event()

    def insert(self, marker: Any, feedback: Any) -> None:
        self.markers[marker.name], self.feedback = marker, feedback

    def setPose(self, name: str, pose: Any) -> None:
        self.markers[name].pose = pose

    def erase(self, name: str) -> None:
        del self.markers[name]

    def applyChanges(self) -> None:
        self.put.set()

    def send(self, event: int, x: float = 0.0, turn: float = 1.0, frame: str = "map") -> None:
        (name,) = self.markers
        message = Feedback(marker_name=name, event_type=event)
        message.header.frame_id = frame
        message.pose.position.x = x
        message.pose.orientation.w = turn
        if event == Feedback.POSE_UPDATE:
            self.markers[name].pose = message.pose
        self.feedback(message)


class World(LocalWorldModel):
    """Tells when it was written to, and may refuse."""

    def __init__(self) -> None:
        super().__init__("rviz")
        self.written = threading.Event()
        self.refuses = False

    def update_element(self, e: Element, context_id: str = "scene") -> str:
        if self.refuses:
            raise WmException("the table is bolted to the floor")
        eid = super().update_element(e, context_id)
        self.written.set()
        return eid


class Setting:
    def __init__(self) -> None:
        self.server = Server()
        self.world = World()
        self.problems: list[tuple[str, str]] = []
        self.told = threading.Event()
        self.now = 0.0
        self.element = Element("skiros:Product", "Table")
        space.set_pose(self.element, Pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        space.set_text(self.element, space.BASE_FRAME, "map")
        self.element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
        self.world.add_element(self.element)
        self.selected = SelectedMarker(self.world, self.on_problem, lambda: self.now)
        self.selected.select(self.element.id)

    def on_problem(self, what: str, error: Exception) -> None:
        self.problems.append((what, str(error)))
        self.told.set()

    def marker(self) -> ElementMarker | None:
        return MarkerFactory(self.world.is_subclass).make(self.world.get_element(self.element.id))

    def show(self) -> None:
        self.selected.show(self.marker())

    @property
    def marker_x(self) -> float:
        (marker,) = self.server.markers.values()
        return float(marker.pose.position.x)

    @property
    def x(self) -> Any:
        return self.world.get_element(self.element.id).value_of(space.POSITION[0])


@pytest.fixture
def setting(monkeypatch: pytest.MonkeyPatch) -> Iterator[Setting]:
    setting = Setting()
    monkeypatch.setattr(selected_marker, "_server", lambda: setting.server)
    setting.show()
    yield setting
    setting.selected.close()
    assert not setting.server.markers


def test_element_is_written_where_the_mouse_is_released(setting: Setting) -> None:
    setting.server.send(Feedback.MOUSE_DOWN, 1.0)
    for x in (2.0, 3.0, 4.0):
        setting.server.send(Feedback.POSE_UPDATE, x)
    setting.server.send(Feedback.MOUSE_UP, 4.0)
    setting.selected.close()  # waits for what is left to write
    assert setting.x == 4.0 and not setting.problems


def test_pose_is_written_in_the_frame_of_the_view(setting: Setting) -> None:
    setting.server.send(Feedback.POSE_UPDATE, 4.0, frame="/table")
    setting.selected.close()
    element = setting.world.get_element(setting.element.id)
    assert space.text(element, space.BASE_FRAME) == "table" and setting.x == 4.0


def test_refused_move_resets_the_marker_and_is_reported(setting: Setting) -> None:
    setting.world.refuses = True
    setting.server.send(Feedback.POSE_UPDATE, 4.0)
    assert setting.told.wait(TIMEOUT)
    assert setting.problems == [(f"moving {setting.element.id}", "the table is bolted to the floor")]
    assert setting.marker_x == 1.0 and setting.x == 1.0
    setting.server.send(Feedback.POSE_UPDATE, 5.0)
    setting.selected.close()
    assert len(setting.problems) == 1, "once for each drag"


def test_moving_a_removed_element_is_reported(setting: Setting) -> None:
    setting.world.remove_element(setting.element)
    setting.server.send(Feedback.POSE_UPDATE, 4.0)
    assert setting.told.wait(TIMEOUT)
    assert "no longer in the scene" in setting.problems[0][1]
    setting.selected.show(None)
    assert not setting.server.markers


def test_held_marker_does_not_follow_the_element(setting: Setting) -> None:
    setting.server.send(Feedback.MOUSE_DOWN, 1.0)
    space.set_numbers(setting.element, space.POSITION, (7.0, 0.0, 0.0))
    setting.world.update_element(setting.element)
    setting.show()
    assert setting.marker_x == 1.0
    setting.server.send(Feedback.MOUSE_UP, 1.0)
    assert setting.marker_x == 7.0
    setting.server.send(Feedback.MOUSE_DOWN, 7.0)
    setting.now = 100.0  # the view has gone
    space.set_numbers(setting.element, space.POSITION, (8.0, 0.0, 0.0))
    setting.world.update_element(setting.element)
    setting.show()
    assert setting.marker_x == 8.0


@pytest.mark.parametrize(("x", "turn"), [(float("nan"), 1.0), (float("inf"), 1.0), (4.0, 0.0), (4.0, float("nan"))])
def test_invalid_pose_is_not_written(setting: Setting, x: float, turn: float) -> None:
    setting.server.send(Feedback.POSE_UPDATE, x, turn)
    setting.server.send(Feedback.MOUSE_UP, x, turn)
    setting.selected.close()
    assert setting.x == 1.0 and not setting.problems


def test_element_that_follows_a_frame_is_not_moved(setting: Setting) -> None:
    space.set_text(setting.element, space.LINKED_TO, "base_link")
    setting.world.update_element(setting.element)
    setting.show()
    setting.server.send(Feedback.POSE_UPDATE, 4.0)
    setting.selected.close()
    assert setting.x == 1.0


def test_selecting_another_element_removes_the_marker(setting: Setting) -> None:
    setting.selected.select("skiros:Product-99")
    assert not setting.server.markers
    setting.show()
    assert not setting.server.markers, "that is not the selected one any more"
    setting.selected.select(setting.element.id)
    setting.show()
    assert len(setting.server.markers) == 1
    setting.selected.select("")
    assert not setting.server.markers
