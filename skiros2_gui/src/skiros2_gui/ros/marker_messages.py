"""What is shown of elements, as messages of visualization_msgs."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import Point, Vector3
from geometry_msgs.msg import Pose as PoseMsg
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import InteractiveMarker, InteractiveMarkerControl, Marker, MarkerArray

from skiros2_gui.core.markers import AXES, BOX, TEXT_HEIGHT, Look, Shown
from skiros2_std_reasoners.core.geometry import IDENTITY, Pose, Vector

#: After the name of a class: the texts of its elements.
TEXTS = " (names)"

_AXIS_LENGTH = 0.15  # m
_AXIS_WIDTH = 0.01
_AXES = (
    ((1.0, 0.0, 0.0), (0.9, 0.2, 0.2, 1.0)),
    ((0.0, 1.0, 0.0), (0.2, 0.8, 0.2, 1.0)),
    ((0.0, 0.0, 1.0), (0.25, 0.4, 1.0, 1.0)),
)
_SMALLEST_HANDLES = 0.4  # m, across: what is smaller is hard to take hold of
_TEXT_COLOUR = (1.0, 1.0, 1.0, 1.0)
_POSE = struct.Struct("<7d")


def pose_message(pose: Pose) -> Any:
    """A pose as a `Pose` of geometry_msgs."""
    message = PoseMsg()
    message.position = Point(*pose.position)
    q = message.orientation
    q.x, q.y, q.z, q.w = pose.orientation
    return message


def shape_marker(look: Look) -> Any:
    """The shape, at no turn in the origin of a frame that is still to be named."""
    marker = Marker(ns=look.group, id=look.number, action=Marker.ADD, frame_locked=True)
    marker.pose = pose_message(IDENTITY)
    marker.color = ColorRGBA(*look.colour)
    if look.shape == AXES:
        marker.type = Marker.LINE_LIST
        marker.scale.x = _AXIS_WIDTH
        for (x, y, z), colour in _AXES:
            end = Point(x * _AXIS_LENGTH, y * _AXIS_LENGTH, z * _AXIS_LENGTH)
            marker.points += [Point(), end]
            marker.colors += [ColorRGBA(*colour)] * 2
    elif look.shape == BOX:
        marker.type = Marker.CUBE
        marker.scale = Vector3(*look.size)
    else:
        marker.type = Marker.MESH_RESOURCE
        marker.mesh_resource = look.mesh
        marker.scale = Vector3(1.0, 1.0, 1.0)
        marker.mesh_use_embedded_materials = look.mesh.lower().endswith(".dae")
        if marker.mesh_use_embedded_materials:
            marker.color = ColorRGBA()  # anything else would tint them
    return marker


def text_marker(look: Look) -> Any:
    """The text, as `shape_marker`."""
    marker = Marker(ns=look.group + TEXTS, id=look.number, action=Marker.ADD, frame_locked=True)
    marker.type = Marker.TEXT_VIEW_FACING
    marker.pose = pose_message(IDENTITY)
    marker.color = ColorRGBA(*_TEXT_COLOUR)
    marker.scale.z = TEXT_HEIGHT
    marker.text = look.text
    return marker


def interactive_marker(name: str, shown: Shown) -> Any:
    """An element that can be taken hold of: its shape, and arrows and rings for the six degrees of freedom.

    One that follows a frame of tf has no arrows and rings, and says what it follows.

    :param name: of the marker, unique among those of its topic.
    """
    look = shown.look
    message = InteractiveMarker(name=name, description=look.text, scale=max(1.5 * look.reach, _SMALLEST_HANDLES))
    message.header.frame_id = shown.frame
    message.pose = pose_message(shown.pose)
    shape = shape_marker(look)
    shape.ns, shape.frame_locked = "", False
    # A bit larger than the marker of the element that it lies over, so that it is this one that is seen.
    shape.scale = Vector3(*(edge * 1.02 for edge in (shape.scale.x, shape.scale.y, shape.scale.z)))
    if look.shape == BOX:
        shape.color = ColorRGBA(1.0, 0.9, 0.2, 0.6)
    body = InteractiveMarkerControl(name="body", always_visible=True, markers=[shape])
    body.interaction_mode = InteractiveMarkerControl.NONE
    message.controls = [body]
    if look.follows:
        message.description = f"{look.text} (follows {look.follows})"
        return message
    body.interaction_mode = InteractiveMarkerControl.MOVE_PLANE
    body.orientation = _turned_to((0.0, 1.0, 0.0))  # the plane of x and y
    for axis, direction in (("x", (1.0, 0.0, 0.0)), ("y", (0.0, 0.0, 1.0)), ("z", (0.0, 1.0, 0.0))):
        for what, mode in (
            ("move", InteractiveMarkerControl.MOVE_AXIS),
            ("rotate", InteractiveMarkerControl.ROTATE_AXIS),
        ):
            control = InteractiveMarkerControl(name=f"{what}_{axis}", interaction_mode=mode)
            control.orientation = _turned_to(direction)
            message.controls.append(control)
    return message


def _turned_to(direction: Vector) -> Any:
    """The orientation of a control, whose own axis is x."""
    half = 0.5**0.5
    return pose_message(Pose((0.0, 0.0, 0.0), (*(half * c for c in direction), half))).orientation  # type: ignore[arg-type]


@dataclass(frozen=True)
class _Packed:
    """The two markers of an element as they go over the wire; `pose_at` is where the pose stands in each."""

    frame: str
    look: Look
    shape: tuple[bytes, bytes]
    text: tuple[bytes, bytes]

    def at(self, shown: Shown) -> tuple[bytes, ...]:
        (before, after), (text_before, text_after) = self.shape, self.text
        turned = shown.pose.orientation
        return (
            before,
            _POSE.pack(*shown.pose.position, *turned),
            after,
            text_before,
            _POSE.pack(*shown.text_position, *IDENTITY.orientation),
            text_after,
        )


class PackedMarkers:
    """Markers of elements as messages that are packed already. Used by one thread.

    To make the markers of a thousand elements anew for each that moves takes longer than a view shows one picture.
    Here a marker is packed when an element looks otherwise, and only its pose is written when it is elsewhere.
    """

    def __init__(self) -> None:
        self._packed: dict[str, _Packed] = {}

    def message(self, put: Sequence[Shown], gone: Sequence[Shown] = ()) -> PackedMarkerArray:
        """The markers of these elements, and the end of those that are gone."""
        parts: list[bytes] = [struct.pack("<I", 2 * (len(put) + len(gone)))]
        for shown in gone:
            parts += _ended(shown.look)
        self.forget(gone)
        for shown in put:
            packed = self._packed.get(shown.id)
            if packed is None or packed.frame != shown.frame or packed.look != shown.look:
                packed = self._packed[shown.id] = _Packed(
                    shown.frame,
                    shown.look,
                    _halves(shape_marker(shown.look), shown.frame),
                    _halves(text_marker(shown.look), shown.frame),
                )
            parts += packed.at(shown)
        return PackedMarkerArray(b"".join(parts))

    def forget(self, gone: Iterable[Shown]) -> None:
        """Drops what is kept of elements that are gone."""
        for shown in gone:
            self._packed.pop(shown.id, None)


class PackedMarkerArray(MarkerArray):
    """A `MarkerArray` that is packed already; for publishing only."""

    def __init__(self, content: bytes) -> None:
        super().__init__()
        self.content = content

    def serialize(self, buff: Any) -> None:
        buff.write(self.content)


def _ended(look: Look) -> Iterable[bytes]:
    for group in (look.group, look.group + TEXTS):
        yield _bytes(Marker(ns=group, id=look.number, action=Marker.DELETE))


def _halves(marker: Any, frame: str) -> tuple[bytes, bytes]:
    """The bytes of a marker before and after its pose."""
    marker.header.frame_id = frame
    content = _bytes(marker)
    # header: number and time, frame; then namespace; then id, type and action
    at = 12 + 4 + len(frame.encode()) + 4 + len(marker.ns.encode()) + 12
    return content[:at], content[at + _POSE.size :]


def _bytes(marker: Any) -> bytes:
    buffer = io.BytesIO()
    marker.serialize(buffer)
    return buffer.getvalue()
