"""How long skills take: given with the skill, or learned from how long they took."""

from __future__ import annotations

import fcntl
import json
import logging
import math
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

from skiros2_common.core.errors import WrongValue
from skiros2_task.core.skill_model import Skill

log = logging.getLogger(__name__)

#: What a skill takes of which nothing is known (s).
UNKNOWN = 1.0
#: So many runs are kept of each skill of each manager; of older ones nothing is left.
KEPT = 50

#: Seconds of the last runs, by skill, by manager.
_Measured = dict[str, dict[str, list[float]]]


class Durations:
    """The seconds that skills take. Any thread may use it, and several processes one file.

    What a skill's description gives counts first; then the median of what was measured with the same manager; then that
    with all managers; then `UNKNOWN`.
    """

    def __init__(self, file: Path | None = None) -> None:
        """
        :param file: where measured durations are kept, as JSON; None: only here. One that cannot be read is logged and
            does no harm.
        """
        self._file = file
        self._lock = threading.Lock()
        self._measured = self._read()

    def seconds(self, skill: Skill, manager: str) -> float:
        """How long a skill is expected to take.

        :param manager: the node name of the robot's skill manager.
        """
        if skill.duration is not None:
            return skill.duration
        with self._lock:
            runs = self._measured.get(skill.name, {})
            some = runs.get(manager) or [seconds for other in runs.values() for seconds in other]
            return median(some) if some else UNKNOWN

    def learn(self, skill: Skill, manager: str, seconds: float) -> None:
        """Takes note of how long a run took that succeeded. Writes the file.

        :raises WrongValue: that is no duration.
        """
        if not (math.isfinite(seconds) and seconds >= 0.0):
            raise WrongValue(f"{skill.name} of {manager} took {seconds!r}, expected seconds")
        with self._lock:
            try:
                with self._alone():
                    if self._file is not None:
                        self._measured = self._read()  # others may have written
                    self._add(skill.name, manager, seconds)
                    self._write()
            except OSError as error:
                log.warning("durations are not kept: %s", error)
                self._add(skill.name, manager, seconds)

    def _add(self, skill: str, manager: str, seconds: float) -> None:
        runs = self._measured.setdefault(skill, {}).setdefault(manager, [])
        runs.append(seconds)
        del runs[:-KEPT]

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """No other process writes the file meanwhile."""
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
            return _checked(json.loads(self._file.read_text(encoding="utf-8")))
        except (OSError, ValueError) as error:
            log.warning("the durations in %s are not used: %s", self._file, error)
            return {}

    def _write(self) -> None:
        if self._file is not None:
            whole = self._file.with_suffix(".new")
            whole.write_text(json.dumps(self._measured, indent=1, sort_keys=True), encoding="utf-8")
            os.replace(whole, self._file)


def _checked(data: object) -> _Measured:
    """
    :raises ValueError: the data are no durations.
    """
    found: _Measured = {}
    for skill, managers in _items(data, "the file"):
        for manager, runs in _items(managers, skill):
            if not isinstance(runs, list):
                raise ValueError(f"{skill} of {manager}: expected a list of seconds")
            for run in runs:
                if isinstance(run, bool) or not isinstance(run, int | float) or not 0.0 <= run < math.inf:
                    raise ValueError(f"{skill} of {manager}: {run!r} is no duration, expected seconds")
            found.setdefault(skill, {})[manager] = [float(seconds) for seconds in runs]
    return found


def _items(data: object, place: str) -> list[tuple[str, object]]:
    if not isinstance(data, dict):
        raise ValueError(f"{place}: expected an object")
    return list(data.items())
