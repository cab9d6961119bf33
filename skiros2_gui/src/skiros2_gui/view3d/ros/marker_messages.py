"""Markers as messages of visualization_msgs."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import Point, Vector3
from geometry_msgs.msg import Pose as PoseMsg
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import InteractiveMarker, InteractiveMarkerControl, Marker

from skiros2_live.core.markers import AXES, BOX, CYLINDER, MESH, SPHERE, TEXT_HEIGHT, ElementMarker, RobotPart, Visual
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector

#: The suffix of the namespace of text markers.
TEXTS = " (names)"

_AXIS_LENGTH = 0.15  # m
_AXIS_WIDTH = 0.01
_AXES = (
    ((1.0, 0.0, 0.0), (0.9, 0.2, 0.2, 1.0)),
    ((0.0, 1.0, 0.0), (0.2, 0.8, 0.2, 1.0)),
    ((0.0, 0.0, 1.0), (0.25, 0.4, 1.0, 1.0)),
)
_SMALLEST_HANDLES = 0.4  # m; smaller handles are hard to grab
_GUIDE_SIZE = 0.08  # m, diameter
_TEXT_COLOUR = (1.0, 1.0, 1.0, 1.0)
_ROBOT_SHAPES = {BOX: Marker.CUBE, CYLINDER: Marker.CYLINDER, SPHERE: Marker.SPHERE, MESH: Marker.MESH_RESOURCE}


def pose_message(pose: Pose) -> Any:
    """Converts a pose to a `geometry_msgs/Pose`."""
    message = PoseMsg()
    message.position = Point(*pose.position)
    q = message.orientation
    q.x, q.y, q.z, q.w = pose.orientation
    return message


def shape_marker(visual: Visual) -> Any:
    """Returns the marker of the shape, with the identity pose and no frame."""
    marker = Marker(ns=visual.group, id=visual.number, action=Marker.ADD, frame_locked=True)
    marker.pose = pose_message(IDENTITY)
    marker.color = ColorRGBA(*visual.colour)
    if visual.shape == AXES:
        marker.type = Marker.LINE_LIST
        marker.scale.x = _AXIS_WIDTH
        for (x, y, z), colour in _AXES:
            end = Point(x * _AXIS_LENGTH, y * _AXIS_LENGTH, z * _AXIS_LENGTH)
            marker.points += [Point(), end]
            marker.colors += [ColorRGBA(*colour)] * 2
    elif visual.shape == BOX:
        marker.type = Marker.CUBE
        marker.scale = Vector3(*visual.size)
    else:
        marker.type = Marker.MESH_RESOURCE
        marker.mesh_resource = visual.mesh
        marker.scale = Vector3(1.0, 1.0, 1.0)
        marker.mesh_use_embedded_materials = visual.mesh.lower().endswith(".dae")
        if marker.mesh_use_embedded_materials:
            marker.color = ColorRGBA()  # any colour would tint the material
    return marker


def robot_marker(part: RobotPart, group: str, number: int) -> Any:
    """Returns the marker of a robot's visual, which follows the tf frame of its link."""
    marker = Marker(ns=group, id=number, action=Marker.ADD, frame_locked=True)
    marker.header.frame_id = part.frame
    marker.pose = pose_message(part.pose)
    marker.type = _ROBOT_SHAPES[part.shape]
    marker.scale = Vector3(*part.size)
    marker.mesh_resource = part.mesh
    marker.mesh_use_embedded_materials = part.colour is None
    marker.color = ColorRGBA(*(part.colour or (0.0, 0.0, 0.0, 0.0)))
    return marker


def element_markers(marker: ElementMarker) -> list[Any]:
    """Returns the markers of an element: its shape and its text, or the deletion of a hidden text."""
    visual = marker.visual
    shape = shape_marker(visual)
    shape.header.frame_id = marker.frame
    shape.pose = pose_message(marker.pose)
    if marker.lift is None:
        return [shape, _deletion(visual.group + TEXTS, visual.number)]
    text = Marker(ns=visual.group + TEXTS, id=visual.number, action=Marker.ADD, frame_locked=True)
    text.header.frame_id = marker.frame
    text.type = Marker.TEXT_VIEW_FACING
    text.pose = pose_message(Pose(marker.text_position, IDENTITY.orientation))
    text.color = ColorRGBA(*_TEXT_COLOUR)
    text.scale.z = TEXT_HEIGHT
    text.text = visual.text
    return [shape, text]


def deletions(visual: Visual) -> list[Any]:
    """Returns the deletions of the markers of an element."""
    return [_deletion(group, visual.number) for group in (visual.group, visual.group + TEXTS)]


def _deletion(group: str, number: int) -> Any:
    return Marker(ns=group, id=number, action=Marker.DELETE)


def interactive_marker(name: str, marker: ElementMarker) -> Any:
    """Returns the interactive marker of an element: its shape, and controls for six degrees of freedom.

    The marker of an element that follows a tf frame has no controls. It has the element's label if that is hidden.

    :param name: of the marker, unique in its topic.
    """
    visual = marker.visual
    message = InteractiveMarker(name=name, scale=max(1.5 * visual.reach, _SMALLEST_HANDLES))
    if marker.lift is None:
        message.description = visual.text
    message.header.frame_id = marker.frame
    message.pose = pose_message(marker.pose)
    shape = shape_marker(visual)
    shape.ns, shape.frame_locked = "", False
    # Slightly larger than the element's own marker, which it covers.
    shape.scale = Vector3(*(edge * 1.02 for edge in (shape.scale.x, shape.scale.y, shape.scale.z)))
    if visual.shape == BOX:
        shape.color = ColorRGBA(1.0, 0.9, 0.2, 0.6)
    body = InteractiveMarkerControl(name="body", always_visible=True, markers=[shape])
    body.interaction_mode = InteractiveMarkerControl.NONE
    message.controls = [body]
    if visual.follows:
        message.description = f"{message.description} follows {visual.follows}".strip()
        return message
    body.interaction_mode = InteractiveMarkerControl.MOVE_PLANE
    body.orientation = _turned_to((0.0, 1.0, 0.0))  # the plane of x and y
    message.controls += _handles(
        {"move": InteractiveMarkerControl.MOVE_AXIS, "rotate": InteractiveMarkerControl.ROTATE_AXIS}
    )
    return message


def guiding_marker(name: str, text: str, frame: str) -> Any:
    """Returns the interactive marker that guides a tool: a sphere, and handles along the axes of the frame.

    :param name: of the marker, unique in its topic.
    :param frame: of its pose and of feedback.
    """
    message = InteractiveMarker(name=name, description=text, scale=_SMALLEST_HANDLES)
    message.header.frame_id = frame  # without a stamp: views report poses in this frame
    message.pose = pose_message(IDENTITY)
    sphere = Marker(type=Marker.SPHERE, scale=Vector3(*(_GUIDE_SIZE,) * 3), color=ColorRGBA(1.0, 0.9, 0.2, 0.5))
    body = InteractiveMarkerControl(name="body", always_visible=True, markers=[sphere])
    body.interaction_mode = InteractiveMarkerControl.MOVE_3D
    message.controls = [body, *_handles({"move": InteractiveMarkerControl.MOVE_AXIS})]
    return message


def _handles(modes: dict[str, int]) -> list[Any]:
    """Returns controls along the three axes: `modes` are the interaction modes by name."""
    controls = []
    for axis, direction in (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 0.0, 1.0)), ("z", (0.0, 1.0, 0.0))):
        for what, mode in modes.items():
            control = InteractiveMarkerControl(name=f"{what}_{axis}", interaction_mode=mode)
            control.orientation = _turned_to(direction)
            controls.append(control)
    return controls


def _turned_to(direction: Vector) -> Any:
    """Returns the orientation of a control along a direction."""
    half = 0.5**0.5
    x, y, z = (half * c for c in direction)
    return pose_message(Pose((0.0, 0.0, 0.0), (x, y, z, half))).orientation
