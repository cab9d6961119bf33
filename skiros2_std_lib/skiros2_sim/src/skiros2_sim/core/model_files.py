"""Finds model files and the meshes that they name."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

import pybullet_data

from skiros2_common.core.errors import ConfigurationError

#: Types of meshes of bodies, and of links in a URDF.
MESHES = (".obj", ".stl")
URDF_MESHES = (*MESHES, ".dae")

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
    searched = ", ".join(dict.fromkeys(str(place) for place in places)) or "no such package"
    raise ConfigurationError(f"model {name} does not exist (searched: {searched})")


def mesh_of(urdf: Path, name: str) -> Path:
    """Returns the file of a mesh that a URDF names.

    :raises ConfigurationError: it does not exist, or is of another type than `URDF_MESHES`.
    """
    plain = name.removeprefix("file://")
    places: Iterable[Path] = [urdf.parent / plain]
    if name.startswith(_PACKAGE):
        # PyBullet's data use package://meshes/... for files beside the URDF.
        package, _, rest = name.removeprefix(_PACKAGE).partition("/")
        places = [*(folder / rest for folder in _package_folders(package)), urdf.parent / package / rest]
    for place in places:
        if place.is_file():
            if place.suffix.lower() not in URDF_MESHES:
                raise ConfigurationError(f"mesh {place}: expected one of {', '.join(URDF_MESHES)}")
            return place.resolve()
    raise ConfigurationError(f"{urdf}: its mesh {name} does not exist")


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
