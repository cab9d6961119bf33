"""The recorded runs in a folder, for the live view."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

from skiros2_bags.core.run import Run
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import nearest
from skiros2_gateway.core.run_view import summary_data
from skiros2_runs.core.task_run import TaskRun

#: Bags kept in memory.
_MAX_OPEN = 2


class Bags:
    """Any thread.

    :param folder: of the bags, also in its subfolders; None: there are none.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._open: dict[str, list[TaskRun]] = {}

    def list(self) -> list[dict[str, Any]]:
        """Returns name, size (bytes) and time of the last change (s since the epoch) of each bag, the newest first."""
        found = [(path, path.stat()) for path in self._paths().values()]
        data = [{"name": self._name(path), "size": stat.st_size, "time": stat.st_mtime} for path, stat in found]
        return sorted(data, key=lambda bag: bag["time"], reverse=True)

    def open(self, name: str) -> dict[str, Any]:
        """Reads a bag. Returns its runs of trees by key, each as of `summary_data`. Blocks.

        :raises UnknownName: there is no such bag.
        :raises BagError: it cannot be read.
        """
        paths = self._paths()
        if name not in paths:
            near = ", ".join(nearest(name, paths)) or "none"
            raise UnknownName(f"there is no bag {name!r} in {self._folder}; near: {near}")
        with self._lock:
            self._open.pop(name, None)
            self._open[name] = runs = Run.open(paths[name]).tasks()
            while len(self._open) > _MAX_OPEN:
                del self._open[next(iter(self._open))]
        return {f"bag/{name}/{number}": summary_data(run) for number, run in enumerate(runs)}

    def find_run(self, key: str) -> TaskRun:
        """Returns a run by its key.

        :raises UnknownName: there is none, or its bag was closed for newer ones.
        """
        name, _, number = key.removeprefix("bag/").rpartition("/")
        with self._lock:
            runs = self._open.get(name, [])
        if not number.isdigit() or int(number) >= len(runs):
            raise UnknownName(f"there is no run {key!r}: open the bag {name!r} first")
        return runs[int(number)]

    def _paths(self) -> dict[str, Path]:
        return {self._name(path): path for path in self._folder.rglob("*.bag")} if self._folder else {}

    def _name(self, path: Path) -> str:
        assert self._folder is not None
        return "~".join(path.relative_to(self._folder).parts)
