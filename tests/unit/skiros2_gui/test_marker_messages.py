"""Markers as messages."""

from __future__ import annotations

from dataclasses import replace

import pytest
from visualization_msgs.msg import InteractiveMarkerControl, Marker

from skiros2_gui.view3d.ros.marker_messages import (
    TEXTS,
    deletions,
    element_markers,
    interactive_marker,
    pose_message,
    robot_marker,
    shape_marker,
)
from skiros2_live.core.markers import AXES, BOX, MESH, ElementMarker, RobotPart, Visual
from skiros2_motion.core.geometry import Pose

TURNED = (0.5, 0.5, 0.5, 0.5)


def visual(shape: str = BOX, text: str = "Größe", follows: str = "", mesh: str = "") -> Visual:
    size = (0.1, 0.2, 0.3) if shape == BOX else (0.0, 0.0, 0.0)
    return Visual("skiros:Teil-ä", 7, text, shape, size, mesh, (0.1, 0.2, 0.3, 0.4), follows)


def marker(x: float = 1.0, frame: str = "größe", its_visual: Visual | None = None) -> ElementMarker:
    return ElementMarker("skiros:Teil-ä-7", frame, Pose((x, 2.0, 3.0), TURNED), its_visual or visual())


@pytest.mark.parametrize(
    "its_visual", [visual(), visual(AXES), visual(MESH, mesh="file:///a.stl"), visual(text="")], ids=str
)
def test_element_is_a_shape_with_its_text_above(its_visual: Visual) -> None:
    shape, text = element_markers(marker(its_visual=its_visual))
    wanted = shape_marker(its_visual)
    wanted.header.frame_id, wanted.pose = "größe", pose_message(Pose((1.0, 2.0, 3.0), TURNED))
    assert shape == wanted
    assert (text.ns, text.id, text.text) == ("skiros:Teil-ä" + TEXTS, 7, its_visual.text)
    assert text.pose.position.x == 1.0 and text.pose.position.z > 3.0 and text.header.frame_id == "größe"


def test_removed_marker_is_deleted() -> None:
    assert [(m.ns, m.id, m.action) for m in deletions(visual())] == [
        ("skiros:Teil-ä", 7, Marker.DELETE),
        ("skiros:Teil-ä" + TEXTS, 7, Marker.DELETE),
    ]


def test_hidden_label_is_deleted() -> None:
    _, text = element_markers(replace(marker(), lift=None))
    assert (text.ns, text.action) == ("skiros:Teil-ä" + TEXTS, Marker.DELETE)
    _, text = element_markers(replace(marker(), lift=0.5))
    assert text.action == Marker.ADD and text.pose.position.z == pytest.approx(marker().text_position[2] + 0.5)


def test_marker_of_a_robot_follows_its_link() -> None:
    part = RobotPart("r/arm", Pose((1.0, 2.0, 3.0), TURNED), MESH, (0.1, 0.1, 0.1), "file:///arm.dae", None)
    message = robot_marker(part, "robot r", 3)
    assert (message.ns, message.id, message.header.frame_id, message.frame_locked) == ("robot r", 3, "r/arm", True)
    assert (message.type, message.mesh_resource) == (Marker.MESH_RESOURCE, "file:///arm.dae")
    assert message.mesh_use_embedded_materials and message.scale.x == 0.1


def test_interactive_marker_has_six_degrees_of_freedom() -> None:
    message = interactive_marker("name", marker())
    modes = [control.interaction_mode for control in message.controls]
    assert modes.count(InteractiveMarkerControl.MOVE_AXIS) == modes.count(InteractiveMarkerControl.ROTATE_AXIS) == 3
    directions = {(q.x, q.y, q.z) for q in (c.orientation for c in message.controls[1:])}
    assert len(directions) == 3
    assert message.header.frame_id == "größe" and message.pose.position.z == 3.0
    assert message.header.stamp.is_zero(), "so its view answers in the same frame"


def test_interactive_marker_that_follows_a_frame_has_no_controls() -> None:
    message = interactive_marker("name", marker(its_visual=visual(follows="base_link")))
    assert [c.interaction_mode for c in message.controls] == [InteractiveMarkerControl.NONE]
    assert "base_link" in message.description
