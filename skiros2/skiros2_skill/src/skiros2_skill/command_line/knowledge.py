"""A world model for a command that needs no running one: with the ontologies of packages and of a workspace."""

from __future__ import annotations

import importlib.util
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import rospkg

from skiros2_common.core.errors import ConfigurationError
from skiros2_world_model.core.knowledge_base import is_knowledge_file
from skiros2_world_model.core.local_world_model import LocalWorldModel, source_ontologies
from skiros2_world_model.core.world_model import WorldModel

#: Where a package keeps its ontologies.
_FOLDERS = ("owl", "ontology", "ontologies")


@contextmanager
def world_model_of(
    packages: Sequence[str], workspace: Path | None, author: str, scene: Path | None = None
) -> Iterator[LocalWorldModel]:
    """A world model in this process that knows the platform's ontologies, those of the packages and of the workspace.

    :param packages: Python packages.
    :param workspace: a folder; None: there is none.
    :param author: who makes the changes.
    :param scene: a file with the scene; None: it is blank.
    :raises ConfigurationError: there is no such workspace, or the scene cannot be read.
    :raises WmException: it is refused.
    """
    if workspace is not None and not workspace.is_dir():
        raise ConfigurationError(f"workspace {workspace}: there is no such folder")
    with tempfile.TemporaryDirectory(prefix="skiros-") as folder:
        _gather([*_folders(packages), *([workspace] if workspace else [])], Path(folder))
        wm = LocalWorldModel(author, WorldModel(_ontologies(), Path(folder)))
        if scene is not None:
            try:
                shutil.copyfile(scene, Path(folder, scene.name))
            except OSError as error:
                raise ConfigurationError(f"scene {scene}: {error.strerror}") from None
            wm.load(scene.name)
        yield wm


def _folders(packages: Sequence[str]) -> Iterator[Path]:
    """The folders with the ontologies of packages."""
    packs = rospkg.RosPack()
    for package in packages:
        try:
            root = Path(packs.get_path(package.partition(".")[0]))
        except rospkg.ResourceNotFound:
            found = _root(package)
            if found is None:
                continue
            root = found
        yield from (root / name for name in _FOLDERS if (root / name).is_dir())


def _root(package: str) -> Path | None:
    """The folder of the ROS package that a Python package lies in; None when there is none."""
    spec = importlib.util.find_spec(package.partition(".")[0])
    if spec is None or not spec.origin:
        return None
    return next((folder for folder in Path(spec.origin).parents if (folder / "package.xml").is_file()), None)


def _gather(folders: Sequence[Path], into: Path) -> None:
    """Copies the ontologies of some folders into one."""
    for number, folder in enumerate(folders):
        for file in sorted(folder.rglob("*")):
            if file.is_file() and is_knowledge_file(file.name):
                shutil.copyfile(file, into / f"{number:03}_{file.name}")


def _ontologies() -> Path:
    """The folder of the platform's own ontologies."""
    try:
        return Path(rospkg.RosPack().get_path("skiros2")) / "ontologies"
    except rospkg.ResourceNotFound:
        return source_ontologies()
