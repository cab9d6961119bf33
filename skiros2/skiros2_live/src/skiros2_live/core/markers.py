"""How elements and robots are drawn in a 3D view: pose, shape, colour and text. Plain data."""

from __future__ import annotations

import colorsys
import os
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element as XmlElement

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import id_number, local_name
from skiros2_common.core.world_element import Element
from skiros2_motion.core.geometry import Pose, Vector, half_extents
from skiros2_motion.core.urdf import of, origin_of, parse_urdf, vector
from skiros2_std_reasoners.core import spatial_data as space

#: Red, green, blue and opacity (0 to 1).
Colour = tuple[float, float, float, float]

#: Shapes.
BOX, MESH, AXES = "box", "mesh", "axes"

#: The height of a capital letter (m).
TEXT_HEIGHT = 0.08

_MODEL = "skiros:CadModel"
_MESHES = (".stl", ".obj", ".dae", ".mesh")

#: The hue and opacity for subclasses of a class; the first match counts. Classes of a family differ slightly in hue.
_FAMILIES = (
    ("skiros:Manipulatable", 0.08, 0.95),
    ("skiros:Location", 0.38, 0.45),
    ("cora:Robot", 0.60, 0.9),
    ("sumo:Device", 0.62, 0.9),
)
_FAMILY_WIDTH = 0.03

_FARTHEST = 1e6  # m, of a position: views overflow beyond
_LARGEST = 1e4  # m, an edge
_LONGEST_TEXT = 60
_LARGEST_ID = 2**31 - 1


@dataclass(frozen=True)
class Visual:
    """How an element is drawn, apart from its pose.

    :param group: the class part of the element's id; with `number` it identifies the marker in a view.
    :param shape: `BOX` of `size`, `MESH` of the file `mesh`, or `AXES`: a frame without extent.
    :param size: edges (m); (0, 0, 0) unless the shape is a box.
    :param mesh: a `file://` or `package://` URL; "" unless the shape is a mesh.
    :param follows: the tf frame that the element follows; "" if it can be moved by hand.
    """

    group: str
    number: int
    text: str
    shape: str
    size: Vector
    mesh: str
    colour: Colour
    follows: str

    @property
    def reach(self) -> float:
        """The longest edge (m); 0.3 if unknown."""
        return max(*self.size, 0.05) if self.shape == BOX else 0.3


@dataclass(frozen=True)
class ElementMarker:
    """The marker of an element.

    :param frame: the tf frame of `pose`, without a leading slash.
    :param own_frame: the tf frame of the element.
    :param lift: how far the text is raised (m); None hides it. See `labels.place_labels`.
    """

    id: str
    frame: str
    pose: Pose
    visual: Visual
    own_frame: str = ""
    lift: float | None = 0.0

    @property
    def text_position(self) -> Vector:
        """Where the text is drawn, along z of `frame`: above the shape, and raised (m)."""
        x, y, z = self.pose.position
        high = half_extents(self.pose.orientation, self.visual.size)[2] if self.visual.shape == BOX else 0.1
        return x, y, z + high + TEXT_HEIGHT + (self.lift or 0.0)


class MarkerFactory:
    """Makes the markers of elements. Used by one thread.

    :param is_subclass: `is_subclass(child, parent)` of the world model; its exceptions are passed on.
    :param folders: searched for meshes with relative names.
    """

    def __init__(self, is_subclass: Callable[[str, str], bool], folders: Sequence[str | Path] = ()) -> None:
        self._is_subclass = is_subclass
        self._folders = [Path(folder) for folder in folders]
        self._colours: dict[str, Colour] = {}
        self._meshes: dict[str, str] = {}

    def forget(self) -> None:
        """Clears the caches of classes and files."""
        self._colours.clear()
        self._meshes.clear()

    def make(self, element: Element) -> ElementMarker | None:
        """Returns the marker of an element; None without a complete pose in a base frame."""
        pose = space.pose_of(element)
        frame = space.text(element, space.BASE_FRAME).lstrip("/")
        own = (space.text(element, space.FRAME) or element.id).lstrip("/")
        if pose is None or not frame or frame == own or max(map(abs, pose.position)) > _FARTHEST:
            return None
        mesh, size = self._mesh(element), _size(element)
        shape = MESH if mesh else AXES if size is None else BOX
        visual = Visual(
            element.id.rpartition("-")[0] or element.type,
            view_number(element.id),
            _text(element),
            shape,
            size if shape == BOX and size is not None else (0.0, 0.0, 0.0),
            mesh,
            self._colour(element.type),
            space.text(element, space.LINKED_TO),
        )
        return ElementMarker(element.id, frame, pose, visual, own)

    def _colour(self, etype: str) -> Colour:
        if etype not in self._colours:
            self._colours[etype] = self._family_colour(etype)
        return self._colours[etype]

    def _family_colour(self, etype: str) -> Colour:
        chance = zlib.crc32(etype.encode()) / 0xFFFFFFFF
        for family, hue, opacity in _FAMILIES:
            if self._is_subclass(etype, family):
                return _rgba(hue + (chance - 0.5) * 2 * _FAMILY_WIDTH, 0.75, opacity)
        return _rgba(chance, 0.35, 0.8)

    def _mesh(self, element: Element) -> str:
        name = space.text(element, _MODEL).strip()
        if name not in self._meshes:
            self._meshes[name] = mesh_address(name, self._folders)
        return self._meshes[name]


def mesh_address(name: str, folders: Sequence[Path]) -> str:
    """Returns the URL of the mesh that `skiros:CadModel` names; "" if it is not a mesh file or does not exist.

    :param name: a relative or absolute path, or `package://PACKAGE/...`, which is not checked. A URDF is not a mesh.
    """
    if os.path.splitext(name)[1].lower() not in _MESHES or "\0" in name:
        return ""
    if name.startswith("package://"):
        return name
    for folder in (*folders, Path("/")):
        path = folder / name.removeprefix("file://")
        try:
            if path.is_file():
                return f"file://{path.resolve()}"
        except OSError:
            continue  # not a valid file name
    return ""


def view_number(eid: str) -> int:
    """Returns the number of an element's id, or a hash if the number does not fit an int32."""
    number = id_number(eid)
    return number if 0 <= number <= _LARGEST_ID else zlib.crc32(eid.encode()) & _LARGEST_ID


def _text(element: Element) -> str:
    text = local_name(element.label.strip()) or local_name(element.id)
    return text if len(text) <= _LONGEST_TEXT else text[: _LONGEST_TEXT - 1] + "…"


def _size(element: Element) -> Vector | None:
    found = [v for v in space.numbers(element, space.SIZE) if v is not None and 0.0 < v <= _LARGEST]
    return (found[0], found[1], found[2]) if len(found) == 3 else None


def _rgba(hue: float, saturation: float, opacity: float) -> Colour:
    red, green, blue = colorsys.hsv_to_rgb(hue % 1.0, saturation, 0.95)
    return red, green, blue, opacity


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
    :raises WrongValue: the text is not a URDF.
    """
    try:
        robot = parse_urdf(text)
        materials = {m.get("name", ""): _colour(m) for m in robot.all("material") if m.find("color") is not None}
        return [
            part
            for link in robot.all("link")
            for visual in link.iter("visual")
            if (part := _part(visual, f"{prefix}/{link.get('name', '')}".lstrip("/"), materials)) is not None
        ]
    except (ValueError, TypeError) as error:
        reason = str(error).removeprefix("not a URDF: ")
        raise WrongValue(f"the robot description is not a URDF: {reason}") from None


def _part(visual: XmlElement, frame: str, materials: Mapping[str, Colour]) -> RobotPart | None:
    geometry = visual.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        return None
    pose = origin_of(visual)
    material = visual.find("material")
    name = material.get("name", "") if material is not None else ""
    own = _colour(material) if material is not None and material.find("color") is not None else None
    colour = own or materials.get(name)
    if shape.tag == "mesh":
        url = shape.get("filename", "")
        address = url if "://" in url else f"file://{url}"
        has_materials = address.lower().endswith((".dae", ".obj"))
        size = vector(shape.get("scale"), "1 1 1")
        return RobotPart(frame, pose, MESH, size, address, None if has_materials else colour or _GREY)
    if shape.tag == "box":
        return RobotPart(frame, pose, BOX, vector(shape.get("size")), "", colour or _GREY)
    width = 2.0 * float(shape.get("radius", "0"))
    if shape.tag == "sphere":
        return RobotPart(frame, pose, SPHERE, (width, width, width), "", colour or _GREY)
    if shape.tag == "cylinder":
        size = (width, width, float(shape.get("length", "0")))
        return RobotPart(frame, pose, CYLINDER, size, "", colour or _GREY)
    return None


def _colour(material: XmlElement) -> Colour:
    red, green, blue, opacity = map(float, of(material, "color", "rgba").split())
    return red, green, blue, opacity
