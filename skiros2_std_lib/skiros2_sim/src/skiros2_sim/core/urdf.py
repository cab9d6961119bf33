"""Finds and loads models: URDFs with checked numbers, resolved meshes, name prefixes and complete inertia.

The reader is `skiros2_motion.core.urdf`; `yourdfpy` would install 26 packages for it.
"""

from __future__ import annotations

import functools
import math
import os
import re
import xml.etree.ElementTree as xml
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from skiros2_common.core.errors import ConfigurationError
from skiros2_motion.core.geometry import IDENTITY, Pose, Vector, to_euler
from skiros2_motion.core.urdf import MOVING, Urdf, parse_urdf
from skiros2_sim.core.bored_box import BoxShape
from skiros2_sim.core.load_test import ENGINE_MODELS, load_error

#: Types of meshes of bodies, and of links in a URDF.
MESHES = (".obj", ".stl")
URDF_MESHES = (*MESHES, ".dae")
#: The largest file (MB).
_MAX_SIZE = 100

_PACKAGE = "package://"


def find_model(name: str, folders: Sequence[str | Path] = ()) -> Path:
    """Returns the file that `skiros:CadModel` names.

    :param name: relative to a folder or to PyBullet's data, absolute, or `package://PACKAGE/...`.
    :raises ConfigurationError: there is no such file, the text lists the searched locations; or it is too large.
    """
    if "\0" in name or not name.strip():
        raise ConfigurationError(f"{name!r} cannot be the name of a model")
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        places = [folder / rest for folder in _package_folders(package)]
    else:
        path = Path(name.removeprefix("file://"))
        places = [Path(folder) / path for folder in (*folders, ENGINE_MODELS)]
    for place in places:
        if place.is_file():
            return _of_bounded_size(place)
    searched = ", ".join(dict.fromkeys(str(place) for place in places)) or "no such package"
    raise ConfigurationError(f"model {name} does not exist (searched: {searched})")


def mesh_of(urdf: Path, name: str, folders: Callable[[str], list[Path]]) -> Path:
    """Returns the file of a mesh that a URDF names.

    :param folders: returns the folders of a ROS package.
    :raises ConfigurationError: it does not exist, is of another type than `URDF_MESHES`, or is too large.
    """
    plain = name.removeprefix("file://")
    places: Iterable[Path] = [urdf.parent / plain]
    if name.startswith(_PACKAGE):
        # PyBullet's data use package://meshes/... for files beside the URDF.
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        places = [*(folder / rest for folder in folders(package)), urdf.parent / package / rest]
    for place in places:
        if place.is_file():
            if place.suffix.lower() not in URDF_MESHES:
                raise ConfigurationError(f"mesh {place}: expected one of {', '.join(URDF_MESHES)}")
            return _of_bounded_size(place)
    raise ConfigurationError(f"its mesh {name} does not exist")


def _of_bounded_size(file: Path) -> Path:
    if file.stat().st_size > _MAX_SIZE << 20:
        raise ConfigurationError(f"{file} has more than {_MAX_SIZE} MB")
    return file.resolve()


def _package_folders(package: str) -> list[Path]:
    """Returns the folders of a ROS package: from the environment, then beside this package."""
    if not re.fullmatch(r"\w[\w-]*", package):
        return []
    found = []
    for root in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if root:
            found += [Path(root) / package, *Path(root).glob(f"*/{package}"), *Path(root).glob(f"*/*/{package}")]
    for folder in Path(__file__).resolve().parents:
        found += [folder / "share" / package, folder / package]
    return [folder for folder in found if (folder / "package.xml").is_file()]


#: Attributes with numbers, and their count; None for any.
_NUMBERS = {
    "xyz": 3,
    "rpy": 3,
    "size": 3,
    "radius": 1,
    "length": 1,
    "scale": None,
    "rgba": 4,
    "lower": 1,
    "upper": 1,
    "effort": 1,
    "velocity": 1,
}
_JOINTS = (*MOVING, "fixed")
_POSITIVE = ("size", "radius", "length")


def read_urdf(path: Path, prefix: str = "") -> Urdf:
    """Reads a model and checks it as the engine needs it.

    :param prefix: added to the names of links, joints and materials.
    :raises ConfigurationError: it is not a valid URDF; the text names file and reason.
    """
    try:
        urdf = parse_urdf(path.read_bytes())
        folders = functools.cache(_package_folders)
        for part in urdf.parts:
            _check_part(part, path, folders)
            _rename(part, prefix)
        urdf.root()
    except (ConfigurationError, OSError) as error:
        raise ConfigurationError(f"{path}: {error}") from None
    urdf.name = urdf.name or path.stem
    for part in urdf.parts:
        if part.tag == "link":
            _complete(part)
    meshes = {mesh.get("filename", "") for mesh in urdf.all("mesh")}
    fault = load_error(path, urdf.text(), [Path(mesh) for mesh in sorted(meshes)])
    if fault:
        raise ConfigurationError(f"{path}: {fault}")
    return urdf


def link(name: str, mass: float = 0.0, size: Vector | None = None) -> xml.Element:
    """Creates a link without a shape, or with a box."""
    made = xml.Element("link", name=name)
    if size is not None:
        for tag in ("visual", "collision"):
            geometry = xml.SubElement(xml.SubElement(made, tag), "geometry")
            xml.SubElement(geometry, "box", size=_text(*size))
    _add_inertia(made, mass)
    return made


def boxes_link(
    name: str, shapes: Iterable[BoxShape], mass: float, inertia: Vector, colour: Sequence[float]
) -> xml.Element:
    """Creates a link of boxes.

    :param mass: kg.
    :param inertia: moments about x, y and z of the link's frame, which is in the centre of mass (kg m2).
    :param colour: red, green, blue, opacity.
    """
    made = xml.Element("link", name=name)
    for shape in shapes:
        for tag in ("visual", "collision"):
            part = xml.SubElement(made, tag)
            turned = _text(*to_euler(shape.orientation))
            xml.SubElement(part, "origin", xyz=_text(*shape.position), rpy=turned)
            size = _text(*(2.0 * edge for edge in shape.half_edges))
            xml.SubElement(xml.SubElement(part, "geometry"), "box", size=size)
            if tag == "visual":
                xml.SubElement(xml.SubElement(part, "material", name="body"), "color", rgba=_text(*colour))
    inertial = xml.SubElement(made, "inertial")
    xml.SubElement(inertial, "mass", value=_text(mass))
    x, y, z = map(_text, inertia)
    xml.SubElement(inertial, "inertia", ixx=x, ixy="0", ixz="0", iyy=y, iyz="0", izz=z)
    xml.indent(made)  # PyBullet splits lines of more than 10000 characters
    return made


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    pose: Pose = IDENTITY,
    axis: str = "1 0 0",
    limits: tuple[float, float] | None = None,
) -> xml.Element:
    """Creates a joint between two links."""
    made = xml.Element("joint", name=name, type=kind)
    xml.SubElement(made, "parent", link=parent)
    xml.SubElement(made, "child", link=child)
    xml.SubElement(made, "origin", xyz=_text(*pose.position), rpy=_text(*to_euler(pose.orientation)))
    xml.SubElement(made, "axis", xyz=axis)
    if limits is not None:
        lower, upper = map(repr, limits)
        xml.SubElement(made, "limit", lower=lower, upper=upper, effort="1000", velocity="10")
    return made


def _check_part(part: xml.Element, path: Path, folders: Callable[[str], list[Path]]) -> None:
    """Checks numbers and sizes, and replaces mesh names by full paths."""
    where = f"{part.tag} {part.get('name')}"
    if not part.get("name"):
        raise ConfigurationError(f"a {part.tag} has no name")
    for node in part.iter():
        for key, count in _NUMBERS.items():
            if key not in node.attrib:
                continue
            text = node.attrib[key] = _plain(node.attrib[key])
            values = _floats(text)
            if not values or not all(map(math.isfinite, values)) or (count and len(values) != count):
                raise ConfigurationError(f"{where}: expected {count or 'some'} finite numbers as {key}, got {text!r}")
            if key in _POSITIVE and min(values) <= 0:
                raise ConfigurationError(f"{where}: expected a {key} above 0, got {text!r}")
        if node.tag == "mass":
            values = _floats(node.get("value", ""))
            if len(values) != 1 or not 0 <= values[0] < math.inf:
                raise ConfigurationError(f"{where}: expected a mass of 0 or more, got {node.get('value')!r}")
        if node.tag == "mesh":
            node.set("filename", str(mesh_of(path, node.get("filename", ""), folders)))
    if part.tag == "joint" and part.get("type") not in _JOINTS:
        raise ConfigurationError(f"{where}: expected one of {', '.join(_JOINTS)}, got {part.get('type')!r}")


def _rename(part: xml.Element, prefix: str) -> None:
    part.set("name", prefix + part.get("name", ""))
    for node in part.iter():
        if node.tag in ("parent", "child") and "link" in node.attrib:
            node.set("link", prefix + node.attrib["link"])
        elif node.tag == "mimic":
            node.set("joint", prefix + node.get("joint", ""))
        elif node.tag == "material" and node is not part:
            node.set("name", prefix + node.get("name", ""))


def _complete(part: xml.Element) -> None:
    """Adds missing inertia; PyBullet would assume 1 kg and print a warning."""
    inertial = part.find("inertial")
    if inertial is None or inertial.find("mass") is None or inertial.find("inertia") is None:
        mass = 0.0
        if inertial is not None:
            found = inertial.find("mass")
            mass = _floats(found.get("value", "0"))[0] if found is not None else 0.0
            part.remove(inertial)
        _add_inertia(part, mass)


def _add_inertia(part: xml.Element, mass: float) -> None:
    inertial = xml.SubElement(part, "inertial")
    xml.SubElement(inertial, "mass", value=repr(mass))
    each = repr(max(mass, 0.1) * 0.01)
    xml.SubElement(inertial, "inertia", ixx=each, iyy=each, izz=each, ixy="0", ixz="0", iyz="0")


def _plain(text: str) -> str:
    """Replaces xacro's `$(optenv NAME default)`, used by PyBullet's Husky, by its default."""
    return re.sub(r"\$\(optenv\s+\w+\s+([^)]*)\)", r"\1", text)


def _floats(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split()]
    except ValueError:
        return []


def _text(*values: float) -> str:
    return " ".join(repr(float(value)) for value in values)
