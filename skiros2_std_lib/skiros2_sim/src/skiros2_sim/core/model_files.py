"""Finds and checks model files: PyBullet may end the process on an invalid file."""

from __future__ import annotations

import functools
import os
import re
import struct
import xml.etree.ElementTree as xml
from collections.abc import Iterable, Sequence
from pathlib import Path

import pybullet_data

from skiros2_common.core.errors import ConfigurationError

#: Types of meshes that are checked before PyBullet reads them.
MESHES = (".obj", ".stl")

_MAX_BYTES = 200_000_000
_MAX_DISTANCE = 1e5  # m, of a corner
_PACKAGE = "package://"


def find_model(name: str, folders: Sequence[str | Path] = ()) -> Path:
    """Returns the file that `skiros:CadModel` names.

    :param name: relative to a folder or to PyBullet's data, absolute, or `package://PACKAGE/...`.
    :raises ConfigurationError: there is no such file; the text lists the searched locations.
    """
    if "\0" in name or not name.strip():
        raise ConfigurationError(f"{name!r} cannot be the name of a model")
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        places = [folder / rest for folder in _package_folders(package)]
    else:
        path = Path(name.removeprefix("file://"))
        places = [Path(folder) / path for folder in (*folders, pybullet_data.getDataPath())]
    for place in places:
        if place.is_file():
            return place.resolve()
    looked = ", ".join(dict.fromkeys(str(place) for place in places)) or "no such package"
    raise ConfigurationError(f"model {name} is not there (looked for: {looked})")


def mesh_of(urdf: Path, name: str) -> Path:
    """Returns the file of a mesh that a URDF names.

    :raises ConfigurationError: it does not exist, or is invalid.
    """
    plain = name.removeprefix("file://")
    places: Iterable[Path] = [urdf.parent / plain]
    if name.startswith(_PACKAGE):
        # PyBullet's data use package://meshes/... for files beside the URDF.
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        places = [*(folder / rest for folder in _package_folders(package)), urdf.parent / package / rest]
    for place in places:
        if place.is_file():
            check_mesh(place)
            return place.resolve()
    raise ConfigurationError(f"{urdf}: its mesh {name} is not there")


def check_mesh(path: Path) -> None:
    """Checks a mesh.

    :raises ConfigurationError: it is invalid; the text names file and reason.
    """
    stat = path.stat()
    reason = _fault_of_mesh(str(path), stat.st_mtime_ns, stat.st_size)
    if reason:
        raise ConfigurationError(f"mesh {path}: {reason}")


@functools.lru_cache(maxsize=1000)
def _fault_of_mesh(name: str, changed: int, size: int) -> str:
    path = Path(name)
    kind = path.suffix.lower()
    if kind == ".dae":
        try:
            xml.parse(path)
        except (xml.ParseError, OSError, ValueError) as error:
            return f"is no XML: {error}"
        return ""
    if kind not in MESHES:
        return f"expected one of {', '.join(MESHES)}, .dae"
    if size > _MAX_BYTES:
        return f"has {size} bytes; expected at most {_MAX_BYTES}"
    try:
        content = path.read_bytes()
    except OSError as error:
        return f"cannot be read: {error}"
    return _fault_of_obj(content) if kind == ".obj" else _fault_of_stl(content)


def _fault_of_obj(content: bytes) -> str:
    vertices = 0
    faces: list[list[bytes]] = []
    for number, line in enumerate(content.splitlines(), 1):
        words = line.split()
        if not words:
            continue
        if words[0] == b"v":
            if not _are_near(words[1:4]):
                return f"line {number}: expected a vertex of three numbers under {_MAX_DISTANCE:.0f}"
            vertices += 1
        elif words[0] == b"f":
            faces.append(words[1:])
    if vertices < 3 or not faces:
        return f"has {vertices} vertices and {len(faces)} faces; expected at least 3 and 1"
    for words in faces:
        for word in words:
            index = word.split(b"/")[0]
            if not re.fullmatch(rb"-?\d{1,9}", index) or not 1 <= _from_start(int(index), vertices) <= vertices:
                return f"a face names vertex {index!r}; there are {vertices}"
    return ""


def _from_start(index: int, count: int) -> int:
    """Converts an OBJ index; negative indices count from the last vertex."""
    return index if index > 0 else count + 1 + index


def _fault_of_stl(content: bytes) -> str:
    if len(content) >= 84:
        (triangles,) = struct.unpack_from("<I", content, 80)
        if len(content) == 84 + 50 * triangles:
            if not triangles:
                return "has no triangle"
            for at in range(84, len(content), 50):
                if not all(abs(x) < _MAX_DISTANCE for x in struct.unpack_from("<12f", content, at)[3:]):
                    return f"triangle {(at - 84) // 50}: expected numbers under {_MAX_DISTANCE:.0f}"
            return ""
    corners = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content)
    if not content.lstrip().startswith(b"solid") or not corners:
        return "is neither a binary STL of the length that it gives nor one in text"
    if len(corners) % 3 or not all(_are_near(corner) for corner in corners):
        return f"expected triangles of numbers under {_MAX_DISTANCE:.0f}"
    return ""


def _are_near(words: Sequence[bytes]) -> bool:
    try:
        return len(words) == 3 and all(abs(float(word)) < _MAX_DISTANCE for word in words)
    except ValueError:
        return False


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
