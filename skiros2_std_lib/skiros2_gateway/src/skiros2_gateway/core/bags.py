"""The recorded runs in a folder, for the live view."""

from __future__ import annotations

import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skiros2_bags.core.bag_file import BagError
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import nearest
from skiros2_gateway.core.recorded_bag import RecordedRuns, bag_cache, read_runs, read_scene
from skiros2_gateway.core.run_view import summary_data
from skiros2_gateway.core.scene_history import SceneHistory, read_history
from skiros2_live.core.scene_view import SceneView
from skiros2_runs.core.task_run import TaskRun

#: Bags kept in memory.
_MAX_OPEN = 2


@dataclass
class _Bag:
    path: Path
    version: tuple[int, int]
    found: RecordedRuns
    scenes: SceneHistory | None = None


class Bags:
    """Any thread.

    :param folder: of the bags, also in its subfolders; None: there are none.
    :param cache: the folder for what was read of them; None: they are read again after each restart.
    """

    def __init__(self, folder: Path | None, cache: Path | None = None) -> None:
        self._folder = folder
        self._cache = bag_cache(cache)
        self._progress: dict[str, Path] = {}
        self._reading = threading.Lock()
        self._open: dict[str, _Bag] = {}

    def list(self) -> list[dict[str, Any]]:
        """Returns name, size (bytes) and time of the last change (s since the epoch) of each bag, the newest first; of
        one that is being read also `progress`, the part that is done.
        """
        data = []
        for name, path in self._paths().items():
            with suppress(OSError):  # it was removed meanwhile
                stat = path.stat()
                data.append({"name": name, "size": stat.st_size, "time": stat.st_mtime})
                if (progress := self._progress.get(name)) is not None:
                    data[-1]["progress"] = float(progress.read_text() or 0.0)
        return sorted(data, key=lambda bag: bag["time"], reverse=True)

    def open(self, name: str) -> dict[str, Any]:
        """Reads a bag. Returns `runs`: its runs of trees by key, each as of `summary_data`, with the key of its `goal`
        if it is a step of one; `goals`, `signals`, `damage`: where the readable part ends, and why. Blocks.

        :raises UnknownName: there is no such bag.
        :raises BagError: it cannot be read.
        """
        paths = self._paths()
        if name not in paths:
            near = ", ".join(nearest(name, paths)) or "none"
            raise UnknownName(f"there is no bag {name!r} in {self._folder}; near: {near}")
        with self._reading:
            bag = self._open.pop(name, None)
            if bag is None or bag.version != _version(paths[name]):
                bag = self._read(name, paths[name])
            self._open[name] = bag
            while len(self._open) > _MAX_OPEN:
                del self._open[next(iter(self._open))]
        found = bag.found
        runs = {f"bag/{name}/{number}": summary_data(task) for number, task in enumerate(found.tasks)}
        for step, goal in found.goal_of.items():
            runs[f"bag/{name}/{step}"]["goal"] = f"bag/{name}/{goal}"
        return {"runs": runs, "goals": found.goals, "signals": found.signals, "damage": found.damage}

    def _read(self, name: str, path: Path) -> _Bag:
        version = _version(path)
        with tempfile.NamedTemporaryFile() as progress:
            self._progress[name] = Path(progress.name)
            try:
                return _Bag(path, version, read_runs(path, self._cache, Path(progress.name)))
            finally:
                del self._progress[name]

    def find_run(self, key: str) -> TaskRun:
        """Returns a run by its key.

        :raises UnknownName: there is none, or its bag was closed for newer ones.
        """
        return self._find(key)[1]

    def scene_at(self, key: str, time: float, view: SceneView) -> dict[str, Any]:
        """Returns elements and robots in the bag of a run at a time, see `SceneHistory.at`. Blocks.

        :param time: s since the epoch.
        :param view: used by one call at a time.
        :raises UnknownName: as `find_run`.
        :raises BagError: the bag cannot be read.
        """
        bag, _ = self._find(key)
        with self._reading:
            if bag.scenes is None:
                bag.scenes = read_history(read_scene(bag.path, self._cache), view)
            return bag.scenes.at(time)

    def _find(self, key: str) -> tuple[_Bag, TaskRun]:
        name, _, number = key.removeprefix("bag/").rpartition("/")
        bag = self._open.get(name)
        runs = {str(index): run for index, run in enumerate(bag.found.tasks)} if bag is not None else {}
        if bag is None or number not in runs:
            raise UnknownName(f"there is no run {key!r}: open the bag {name!r} first")
        return bag, runs[number]

    def _paths(self) -> dict[str, Path]:
        """Returns the files by name, in which `~` separates folders; no links to nowhere, pipes or devices.

        In the name of a file or folder, `~`, `\\` and what cannot be printed is written as `\\u{7e}`, bytes that are
        no UTF-8 as `\\xe9`.
        """
        found: dict[str, Path] = {}
        if self._folder is None:
            return found
        for path in filter(_is_file, self._folder.rglob("*.bag")):
            found["~".join(map(_coded, path.relative_to(self._folder).parts))] = path
        return found


def _version(path: Path) -> tuple[int, int]:
    """Returns what differs once a file has changed.

    :raises BagError: it cannot be read.
    """
    try:
        stat = path.stat()
    except OSError as error:
        raise BagError(f"{path}: {error}") from error
    return stat.st_size, stat.st_mtime_ns


def _coded(name: str) -> str:
    return "".join(each if each.isprintable() and each not in "\\~" else _code(ord(each)) for each in name)


def _code(number: int) -> str:
    is_byte = 0xDC80 <= number <= 0xDCFF  # PEP 383: a byte of a file name that is no UTF-8
    return f"\\x{number - 0xDC00:02x}" if is_byte else f"\\u{{{number:x}}}"


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a link in a circle
        return False
