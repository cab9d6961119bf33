"""Finds packages with skills that are not installed: beside a scene, or in the working directory."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path


def find_libraries(packages: Iterable[str], *folders: Path) -> None:
    """Puts the folders of Python packages that Python does not find yet on its path.

    A package NAME is looked for as `NAME`, `src/NAME` and `NAME/src/NAME` in the working directory, in each folder, and
    in the folder above that. A package that is found nowhere is left to the import, which reports it.

    :param folders: of a scene, or of another file that names packages.
    """
    places = [Path.cwd(), *(place for folder in folders for place in (folder.resolve(), folder.resolve().parent))]
    for name in dict.fromkeys(package.partition(".")[0] for package in packages):
        if not _is_importable(name):
            candidates = (inner for place in places for inner in (place, place / "src", place / name / "src"))
            found = next((inner for inner in candidates if (inner / name / "__init__.py").is_file()), None)
            if found is not None:
                sys.path.insert(0, str(found))
                importlib.invalidate_caches()


def libraries_beside(scene: Path) -> list[str]:
    """The Python packages in the folder `src` beside a scene's folder; those beside the scene if there are none."""
    folders = (scene.resolve().parent.parent / "src", scene.resolve().parent)
    found = (sorted(file.parent.name for file in folder.glob("*/__init__.py")) for folder in folders)
    return next((names for names in found if names), [])


def _is_importable(name: str) -> bool:
    """Whether there is such a module; a folder without `__init__.py` does not count."""
    try:
        spec = find_spec(name)
    except (ImportError, ValueError):
        return False
    return spec is not None and spec.origin is not None
