"""A world model in this process with the ontologies of packages and a workspace."""

from __future__ import annotations

import importlib.util
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from skiros2_common.command_line.ros_packages import package_folder
from skiros2_common.core.errors import ConfigurationError
from skiros2_world_model.command_line.scene_file import base_ontologies
from skiros2_world_model.core.knowledge_base import is_knowledge_file
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

#: The folders of a package that may have ontologies.
_FOLDERS = ("owl", "ontology", "ontologies", "scene")


@contextmanager
def world_model_of(
    packages: Sequence[str],
    workspace: Path | None,
    author: str,
    scene: Path | None = None,
    skip_broken: bool = False,
) -> Iterator[LocalWorldModel]:
    """Yields a world model with the ontologies of the platform, of packages and of a workspace.

    :param packages: Python packages.
    :param workspace: a folder, or None.
    :param author: of changes.
    :param scene: a scene file; None: a blank scene.
    :param skip_broken: logs and skips an ontology that does not parse.
    :raises ConfigurationError: the workspace does not exist, or the scene cannot be read.
    :raises WmException: the scene is refused.
    """
    if workspace is not None and not workspace.is_dir():
        raise ConfigurationError(f"workspace {workspace}: there is no such folder")
    with tempfile.TemporaryDirectory(prefix="skiros-") as folder:
        _gather([*ontology_folders(packages), *([workspace] if workspace else [])], Path(folder))
        wm = LocalWorldModel(author, WorldModel(base_ontologies(), Path(folder), blank_on_error=skip_broken))
        if scene is not None:
            try:
                shutil.copyfile(scene, Path(folder, scene.name))
            except OSError as error:
                raise ConfigurationError(f"scene {scene}: {error.strerror}") from None
            wm.load(scene.name)
        yield wm


def ontology_folders(packages: Sequence[str]) -> Iterator[Path]:
    """The ontology folders of packages, except that of the platform."""
    for package in packages:
        root = package_folder(package.partition(".")[0]) or _root(package)
        folders = [root / name for name in _FOLDERS] if root is not None else []
        yield from (folder for folder in folders if folder.is_dir() and not (folder / "skiros.ttl").is_file())


def _root(package: str) -> Path | None:
    """The folder of the ROS package that contains a Python package, or the one above `src`; None if there is none."""
    spec = importlib.util.find_spec(package.partition(".")[0])
    if spec is None or not spec.origin:
        return None
    folders = Path(spec.origin).parents
    above_src = (folder.parent for folder in folders if folder.name == "src")
    return next((folder for folder in folders if (folder / "package.xml").is_file()), next(above_src, None))


def _gather(folders: Sequence[Path], into: Path) -> None:
    """Copies the ontologies of folders into one folder."""
    for number, folder in enumerate(folders):
        for file in sorted(folder.rglob("*")):
            if file.is_file() and is_knowledge_file(file.name):
                shutil.copyfile(file, into / f"{number:03}_{file.name}")
