"""Elements and robots as JSON data for the 3D view: shapes and colours as in the window and in rviz."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from skiros2_common.core.world_element import Element
from skiros2_live.core.element_data import element_data
from skiros2_live.core.markers import MESH, MarkerFactory, RobotPart, read_robot
from skiros2_motion.core.geometry import Pose


class SceneView:
    """Used by one thread, except `meshes`.

    :param is_subclass: `is_subclass(child, parent)` of the world model.
    :param folders: searched for meshes with relative names.
    :ivar meshes: the URLs of the meshes of all elements and robots seen: those that viewers may read.
    """

    def __init__(self, is_subclass: Callable[[str, str], bool], folders: Sequence[str | Path] = ()) -> None:
        self._factory = MarkerFactory(is_subclass, folders)
        self.meshes: set[str] = set()

    def element(self, element: Element) -> dict[str, Any]:
        """Returns an element as `element_data` does, with `marker` if it has a pose: {frame, own, pose, shape, size,
        mesh, colour, text}. `own` is the tf frame of the element.
        """
        data = element_data(element)
        marker = self._factory.make(element)
        if marker is not None:
            visual = marker.visual
            if visual.mesh:
                self.meshes.add(visual.mesh)
            data["marker"] = {
                "frame": marker.frame,
                "own": marker.own_frame,
                "pose": pose_data(marker.pose),
                "shape": visual.shape,
                "size": list(visual.size),
                "mesh": visual.mesh,
                "colour": [round(part, 3) for part in visual.colour],
                "text": visual.text,
            }
        return data

    def robot(self, urdf: str, prefix: str) -> list[dict[str, Any]]:
        """Returns the visuals of a robot: {frame, pose, shape, size, mesh, colour}.

        :param prefix: of the tf frames of its links.
        :raises WrongValue: the text is not a URDF.
        """
        parts = read_robot(urdf, prefix)
        self.meshes.update(part.mesh for part in parts if part.shape == MESH)
        return [_part_data(part) for part in parts]


def frames_data(message: Any) -> dict[str, list[Any]]:
    """Returns the transforms of a `tf2_msgs/TFMessage` as [parent, x, y, z, qx, qy, qz, qw] (m) by child."""
    frames = {}
    for transform in message.transforms:
        t, q = transform.transform.translation, transform.transform.rotation
        pose = [round(float(value), 4) for value in (t.x, t.y, t.z, q.x, q.y, q.z, q.w)]
        frames[transform.child_frame_id.lstrip("/")] = [transform.header.frame_id.lstrip("/"), *pose]
    return frames


def pose_data(pose: Pose) -> list[float]:
    """Returns x, y, z (m) and a quaternion x, y, z, w."""
    return [round(value, 5) for value in (*pose.position, *pose.orientation)]


def _part_data(part: RobotPart) -> dict[str, Any]:
    return {
        "frame": part.frame,
        "pose": pose_data(part.pose),
        "shape": part.shape,
        "size": list(part.size),
        "mesh": part.mesh,
        "colour": list(part.colour) if part.colour is not None else None,
    }
