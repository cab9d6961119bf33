"""The visible parts of a robot's URDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as xml
from collections.abc import Mapping
from dataclasses import dataclass

from skiros2_common.core.errors import WrongValue
from skiros2_gui.view3d.markers import BOX, MESH, Colour
from skiros2_std_reasoners.core.geometry import Pose, Vector, from_euler

CYLINDER, SPHERE = "cylinder", "sphere"

_GREY: Colour = (0.7, 0.72, 0.75, 1.0)


@dataclass(frozen=True)
class RobotPart:
    """A visual of a link.

    :param frame: the tf frame of the link.
    :param pose: in that frame.
    :param shape: `BOX`, `CYLINDER`, `SPHERE` or `MESH`.
    :param size: edges (m), diameters for round shapes; the scale of a mesh.
    :param mesh: a URL; "" unless the shape is a mesh.
    :param colour: None to use the materials of the mesh.
    """

    frame: str
    pose: Pose
    shape: str
    size: Vector
    mesh: str
    colour: Colour | None


def read_robot(text: str, prefix: str = "") -> list[RobotPart]:
    """Returns the visuals of a URDF.

    :param prefix: of the tf frames of its links, without a slash at its end; "" for none.
    :raises WrongValue: the text is no URDF.
    """
    try:
        robot = xml.fromstring(text)
        materials = {m.get("name", ""): _colour(m) for m in robot.iter("material") if m.find("color") is not None}
        return [
            part
            for link in robot.iter("link")
            for visual in link.iter("visual")
            if (part := _part(visual, f"{prefix}/{link.get('name', '')}".lstrip("/"), materials)) is not None
        ]
    except (xml.ParseError, ValueError, TypeError) as error:
        raise WrongValue(f"the robot description is no URDF: {error}") from None


def _part(visual: xml.Element, frame: str, materials: Mapping[str, Colour]) -> RobotPart | None:
    geometry = visual.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        return None
    origin = visual.find("origin")
    position = _vector(origin.get("xyz") if origin is not None else None, "0 0 0")
    roll, pitch, yaw = _vector(origin.get("rpy") if origin is not None else None, "0 0 0")
    pose = Pose(position, from_euler(roll, pitch, yaw))
    material = visual.find("material")
    name = material.get("name", "") if material is not None else ""
    own = _colour(material) if material is not None and material.find("color") is not None else None
    colour = own or materials.get(name)
    if shape.tag == "mesh":
        url = shape.get("filename", "")
        address = url if "://" in url else f"file://{url}"
        has_materials = address.lower().endswith((".dae", ".obj"))
        size = _vector(shape.get("scale"), "1 1 1")
        return RobotPart(frame, pose, MESH, size, address, None if has_materials else colour or _GREY)
    if shape.tag == "box":
        return RobotPart(frame, pose, BOX, _vector(shape.get("size"), "0 0 0"), "", colour or _GREY)
    width = 2.0 * float(shape.get("radius", "0"))
    if shape.tag == "sphere":
        return RobotPart(frame, pose, SPHERE, (width, width, width), "", colour or _GREY)
    if shape.tag == "cylinder":
        size = (width, width, float(shape.get("length", "0")))
        return RobotPart(frame, pose, CYLINDER, size, "", colour or _GREY)
    return None


def _colour(material: xml.Element) -> Colour:
    colour = material.find("color")
    red, green, blue, opacity = map(float, (colour.get("rgba", "") if colour is not None else "").split())
    return red, green, blue, opacity


def _vector(text: str | None, default: str) -> Vector:
    x, y, z = map(float, (text or default).split())
    if not all(map(math.isfinite, (x, y, z))):
        raise ValueError(f"numbers are not finite: {text}")
    return x, y, z
