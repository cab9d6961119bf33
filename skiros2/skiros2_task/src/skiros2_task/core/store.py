"""Files that planning keeps: measured durations of skills, and the files of the last requests for debugging."""

from __future__ import annotations

import fcntl
import json
import logging
import math
import os
import re
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.skills import Skill

log = logging.getLogger(__name__)

#: The folder of the files.
FOLDER = Path("~/.skiros/planner")

#: The file in it with the measured durations.
DURATIONS_FILE = "durations.json"

#: The duration of a skill that is neither declared nor measured (s).
DEFAULT_DURATION = 1.0
#: The number of runs kept per skill and manager.
MAX_RUNS = 50

#: Durations of the last runs (s), by skill, by manager.
_Measured = dict[str, dict[str, list[float]]]


class Durations:
    """Expected durations of skills. Thread-safe; several processes may share one file.

    In this order: the declared duration, the median of the runs on the same manager, the median of the runs on all
    managers, `DEFAULT_DURATION`.
    """

    def __init__(self, file: Path | None = None) -> None:
        """
        :param file: stores measured durations as JSON; None: in memory only. An unreadable file is logged and ignored.
        """
        self._file = file
        self._lock = threading.Lock()
        self._measured = self._read()

    def seconds(self, skill: Skill, manager: str) -> float:
        """Returns the expected duration of a skill (s).

        :param manager: the node name of the robot's skill manager.
        """
        if skill.duration is not None:
            return skill.duration
        with self._lock:
            runs = self._measured.get(skill.name, {})
            some = runs.get(manager) or [seconds for other in runs.values() for seconds in other]
            return median(some) if some else DEFAULT_DURATION

    def record(self, skill: Skill, manager: str, seconds: float) -> None:
        """Records the duration of a successful run and writes the file.

        :raises WrongValue: the duration is negative or not finite.
        """
        _seconds(skill.name, manager, seconds)
        with self._lock:
            try:
                with self._file_lock():
                    if self._file is not None:
                        self._measured = self._read()  # another process may have written
                    self._add(skill.name, manager, seconds)
                    self._write()
            except OSError as error:
                log.warning("durations are not stored: %s", error)
                self._add(skill.name, manager, seconds)

    def _add(self, skill: str, manager: str, seconds: float) -> None:
        runs = self._measured.setdefault(skill, {}).setdefault(manager, [])
        runs.append(seconds)
        del runs[:-MAX_RUNS]

    @contextmanager
    def _file_lock(self) -> Iterator[None]:
        """Locks the file against writes of other processes."""
        if self._file is None:
            yield
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _read(self) -> _Measured:
        if self._file is None or not self._file.exists():
            return {}
        try:
            measured = json.loads(self._file.read_text(encoding="utf-8"))
            return {
                skill: {manager: [_seconds(skill, manager, run) for run in runs] for manager, runs in managers.items()}
                for skill, managers in measured.items()
            }
        except (OSError, ValueError, AttributeError, TypeError) as error:
            log.warning("durations in %s are ignored: %s", self._file, error)
            return {}

    def _write(self) -> None:
        if self._file is not None:
            new = self._file.with_suffix(".new")
            new.write_text(json.dumps(self._measured, indent=1, sort_keys=True), encoding="utf-8")
            os.replace(new, self._file)


def _seconds(skill: str, manager: str, seconds: object) -> float:
    """Returns a duration.

    :raises WrongValue: it is none.
    """
    if isinstance(seconds, bool) or not isinstance(seconds, int | float) or not 0.0 <= seconds < math.inf:
        raise WrongValue(f"{skill} of {manager} took {seconds!r}, expected seconds")
    return float(seconds)


_FOLDER_NAME = re.compile(r"\d{8}-\d{6}-\w+$")


class Archive:
    """A folder with the PDDL of the latest request, and a subfolder for each of the last requests."""

    def __init__(self, folder: Path, count: int = 50) -> None:
        """
        :param folder: created on first use.
        :param count: the number of requests to keep.
        """
        self._folder = folder
        self._count = count
        self._lock = threading.Lock()

    def keep(self, texts: Mapping[str, str]) -> None:
        """Stores the texts of a request, by file name. A folder that cannot be written is logged and ignored."""
        try:
            with self._lock:
                self._keep(texts)
        except OSError as error:
            log.warning("the files of this plan are not archived: %s", error)

    def _keep(self, texts: Mapping[str, str]) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        request = Path(tempfile.mkdtemp(prefix=time.strftime("%Y%m%d-%H%M%S-"), dir=self._folder))
        for name, text in texts.items():
            (request / name).write_text(text, encoding="utf-8")
            if name.endswith(".pddl"):
                # Atomic: other processes may read and write the same folder.
                latest = request / f"{name}.latest"
                latest.write_text(text, encoding="utf-8")
                os.replace(latest, self._folder / name)
        requests = [p for p in self._folder.iterdir() if p.is_dir() and _FOLDER_NAME.match(p.name)]
        requests.sort(key=lambda p: (p.name[:15], p.stat().st_mtime_ns))  # names resolve only seconds
        for old in requests[: -self._count]:
            shutil.rmtree(old, ignore_errors=True)
