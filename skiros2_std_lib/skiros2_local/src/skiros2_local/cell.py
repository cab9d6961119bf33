"""Cells of commands: a scene whose state outlives them. Each command finds it as the one before has left it."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

from skiros2_common.command_line.command import Unavailable, UsageError, user
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.file_lock import FileInUse
from skiros2_common.core.world_element import Element
from skiros2_common.tools.libraries import find_libraries, libraries_beside
from skiros2_local.manager import LocalGoalClient, LocalManager
from skiros2_local.system import LocalRobot, LocalSystem
from skiros2_skill.command_line.local_world_model import ontology_folders
from skiros2_skill.core.runtime.history import Record
from skiros2_world_model.core.journal import Journal, is_recoverable
from skiros2_world_model.core.knowledge_base import is_knowledge_file
from skiros2_world_model.core.local_world_model import LocalWorldModel

#: The folders of the cells.
CELLS = Path("~/.skiros2/cells")
#: Where a scene is looked for in the working directory.
_SCENES = ("scene.ttl", "owl/scene.ttl", "*/owl/scene.ttl")


class CommandCell:
    """Opens the cell that the arguments of a command name."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Adds the arguments that name the cell."""
        group = parser.add_argument_group("the cell")
        group.add_argument(
            "--scene", type=Path, metavar="FILE", help=f"scene file (default: {', '.join(_SCENES)} in this folder)"
        )
        group.add_argument(
            "--libraries", nargs="+", metavar="PACKAGE",
            help="skill libraries of the robots; looked for beside the scene and in this folder, too (default: those "
            "in the folder src beside the folder of the scene)",
        )  # fmt: skip
        group.add_argument("--workspace", type=Path, metavar="DIR", help="a further folder with ontologies")
        group.add_argument("--skills", nargs="+", metavar="CLASS", help="skills to use (default: all of the libraries)")

    @contextmanager
    def manager(self, arguments: argparse.Namespace, reads: bool) -> Iterator[LocalManager]:
        """Opens the cell, and yields the manager of its robot, or of the one that `--robot` names.

        :param reads: whether no skill is started.
        """
        with self._open(arguments, reads) as cell:
            yield LocalManager(cell.robot(arguments.robot), arguments.author, cell.world(arguments.author))

    @contextmanager
    def goal_client(self, arguments: argparse.Namespace) -> Iterator[LocalGoalClient]:
        """Opens the cell with its robots. Yields a client for one goal."""
        with self._open(arguments) as cell:
            yield LocalGoalClient(cell.system)

    @contextmanager
    def world_model(self, arguments: argparse.Namespace) -> Iterator[LocalWorldModel]:
        """Opens the cell with its robots, to read. Yields its world model."""
        with self._open(arguments, reads=True) as cell:
            yield cell.world(user())

    @contextmanager
    def scene(self, arguments: argparse.Namespace, author: str, reads: bool) -> Iterator[LocalWorldModel]:
        """Opens the cell without its robots. Yields its world model."""
        if arguments.wm != "wm":
            raise UsageError(f"there is no world model {arguments.wm}: without ROS, a cell has one")
        with self._open(arguments, reads=reads, robots=False) as cell:
            yield cell.world(author)

    @contextmanager
    def _open(self, arguments: argparse.Namespace, reads: bool = False, robots: bool = True) -> Iterator[Cell]:
        scene = arguments.scene or _scene_here()
        if not scene.is_file():
            raise WrongValue(f"scene {scene}: there is no such file")
        libraries = libraries_beside(scene) if arguments.libraries is None else arguments.libraries
        find_libraries(libraries, scene.parent)
        with closing(Cell(scene, libraries, reads, arguments.workspace)) as cell:
            if robots:
                cell.add_robots(libraries, arguments.skills)
            yield cell


class Cell:
    """A scene with robots. Its changes and the records of its tasks are kept in a folder of `CELLS`.

    It starts again from the scene file when this, or an ontology beside it, has changed. One process writes a cell at a
    time; any number read it meanwhile.

    :param scene: the file.
    :param libraries: packages with skills, whose ontologies are loaded.
    :param reads: whether nothing is changed.
    :param workspace: a further folder with ontologies.
    :raises Unavailable: another command uses the cell.
    :raises SkirosError: a file cannot be read.
    """

    def __init__(self, scene: Path, libraries: Sequence[str], reads: bool, workspace: Path | None = None) -> None:
        if workspace is not None and not workspace.is_dir():
            raise WrongValue(f"workspace {workspace}: there is no such folder")
        path = scene.resolve()
        name = path.parent.parent.name if path.parent.name in ("owl", "scene") else path.parent.name
        self._folder = CELLS.expanduser() / f"{name}-{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
        file = self._folder / "journal"
        own = {file.resolve() for file in path.parent.rglob("*")}
        folders = [*ontology_folders(libraries), *([workspace] if workspace else [])]
        ontologies = [file for file in _ontologies(folders) if file.resolve() not in own]
        origin = _origin([path, *_ontologies([path.parent]), *ontologies])
        continues = is_recoverable(file, origin)
        if file.is_file() and not continues:
            sys.stderr.write(f"{scene} or an ontology has changed: the cell starts again from these files\n")
        self._journal: Journal | None = None
        if not (reads and continues):
            try:
                self._journal = Journal(file, origin)
            except FileInUse:
                raise Unavailable(f"another command uses the cell of {scene}; wait for its end") from None
        recorded = file if continues else None
        self.system = LocalSystem(scene, ontologies=ontologies, journal=self._journal, recorded=recorded)
        self._records = self._read_records() if continues else {}

    def add_robots(self, libraries: Sequence[str], skills: Sequence[str] | None) -> None:
        """Starts all robots of the scene that have a label, with the same skills."""
        labels = [e.label for e in self.world("cell").resolve_elements(Element("cora:Robot")) if e.label]
        for label in dict.fromkeys(labels):
            name = f"/{label.rpartition(':')[2]}"
            self.system.add_robot(label, libraries, skills, self._records.get(name, ()))

    def robot(self, name: str) -> LocalRobot:
        """Returns a robot.

        :param name: with or without slash; "": the only one.
        :raises UnknownName: there is none, or there are several.
        """
        robots = self.system.robots
        if not name and len(robots) > 1:
            raise UsageError(f"there are {len(robots)} skill managers, {', '.join(robots)}: name one with --robot")
        found = robots.get(f"/{name.lstrip('/')}") if name else next(iter(robots.values()), None)
        if found is None:
            raise UnknownName(f"the scene has no robot {name}; there are: {', '.join(robots) or 'none'}")
        return found

    def world(self, author: str) -> LocalWorldModel:
        """Returns a client of the world model."""
        return LocalWorldModel(author, self.system.model)

    def close(self) -> None:
        """Ends all tasks and threads, and keeps the records of the tasks."""
        self.system.close()
        if self._journal is not None:
            self._records.update({robot.name: robot.records for robot in self.system.robots.values()})
            self._write_records()
            self._journal.close(clean=False)  # so that the next command continues

    @property
    def _records_file(self) -> Path:
        return self._folder / "tasks.json"

    def _read_records(self) -> dict[str, list[Record]]:
        try:
            data = json.loads(self._records_file.read_text())
            return {robot: [Record.from_dict(record) for record in records] for robot, records in data.items()}
        except FileNotFoundError:
            return {}
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            sys.stderr.write(f"{self._records_file} cannot be read ({error}): earlier tasks are not known\n")
            return {}

    def _write_records(self) -> None:
        data = {robot: [record.to_dict() for record in records] for robot, records in self._records.items()}
        file = self._records_file
        file.with_suffix(".new").write_text(json.dumps(data))
        file.with_suffix(".new").replace(file)


def _scene_here() -> Path:
    """The scene in the working directory.

    :raises UsageError: there is none, or there are several.
    """
    found = next((files for pattern in _SCENES if (files := sorted(Path().glob(pattern)))), [])
    if len(found) != 1:
        there = f"there are {', '.join(map(str, found))}" if found else f"this folder has no {', '.join(_SCENES)}"
        raise UsageError(f"{there}: name a scene with --scene")
    return found[0]


def _ontologies(folders: Iterable[Path]) -> list[Path]:
    """The files with ontologies and shapes in folders and their subfolders."""
    files = (file for folder in folders for file in folder.rglob("*") if is_knowledge_file(file.name))
    return sorted(file for file in files if file.is_file())


def _origin(files: Iterable[Path]) -> str:
    """Identifies the contents of files."""
    parts = (hashlib.sha256(file.read_bytes()).hexdigest() for file in files)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
