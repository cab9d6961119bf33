"""Bags are read in a process of their own: one that was made to harm ends that process, and not the gateway.

`python3 -m skiros2_gateway.core.recorded_bag PART PATH BYTES PROGRESS` writes the part (`runs` or `scene`) of a bag to
its output; it takes at most that many bytes of memory. The file PROGRESS has the part that is done (0 to 1).
"""

from __future__ import annotations

import io
import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

from skiros2_bags.core.bag_file import MONITOR, BagError, BagFile, Message
from skiros2_bags.core.recorded_cell import goal_indices, recorded_cell
from skiros2_bags.core.recorded_signals import recorded_signals
from skiros2_bags.core.run import Run
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_gateway.core.bag_cache import BagCache
from skiros2_live.core.cell import CellDocument
from skiros2_live.core.scene_view import frames_data
from skiros2_runs.core.task_run import TaskRun
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene

#: The most memory (bytes) and time (s) for reading a bag.
MAX_MEMORY = 2 * 1024**3
_MAX_TIME = 300.0

_TF = ("/tf", "/tf_static")

#: The status of a process whose output says why the bag cannot be read.
_REFUSED = 3

#: How often a part goes through the bag, about, and after how many messages the progress is written.
_PASSES = {"runs": 4, "scene": 3}
_REPORTED = 500


@dataclass
class RecordedRuns:
    """The runs of trees in a bag, its goals and its signals (JSON data).

    :param goal_of: the index of the goal of each task that runs a step, by the index of that task.
    :param damage: where the readable part of the bag ends, and why; "" if it is whole.
    """

    tasks: list[TaskRun]
    goal_of: dict[int, int]
    goals: Any
    signals: Any
    damage: str


@dataclass
class RecordedScene:
    """The scene in a bag over time (s since the epoch).

    :param descriptions: URDF and tf prefix of the robots by name.
    :param elements: time, id and state of each element that has changed; None: it was removed.
    :param frames: time, name and JSON data of the frames.
    """

    start: float
    descriptions: dict[str, tuple[str, str]]
    elements: list[tuple[float, str, Element | None]] = field(default_factory=list)
    frames: list[tuple[float, str, list[Any]]] = field(default_factory=list)


def read_runs(path: Path, cache: BagCache | None = None, progress: Path | None = None) -> RecordedRuns:
    """Reads the runs of a bag. Blocks.

    :param progress: a file, which has the part that is done (0 to 1).
    :raises BagError: it cannot be read within the limits of memory and time.
    """
    runs = _load("runs", path, cache, progress)
    assert isinstance(runs, RecordedRuns)
    return runs


def read_scene(path: Path, cache: BagCache | None = None, progress: Path | None = None) -> RecordedScene:
    """Reads the scene in a bag. Blocks; as `read_runs`."""
    scene = _load("scene", path, cache, progress)
    assert isinstance(scene, RecordedScene)
    return scene


def bag_cache(folder: Path | None) -> BagCache:
    """Returns the cache in a folder; None: nothing is kept."""
    modules = (__name__, TaskRun.__module__, CellDocument.__module__, recorded_cell.__module__, Run.__module__)
    return BagCache(folder, [Path(str(sys.modules[name].__file__)) for name in modules])


def _load(part: str, path: Path, cache: BagCache | None, progress: Path | None) -> Any:
    return pickle.loads((cache or BagCache(None)).get(part, path, lambda: _read(part, path, progress)))


def _read(part: str, path: Path, progress: Path | None) -> bytes:
    command = [sys.executable, "-m", __name__, part, str(path), str(MAX_MEMORY), str(progress or os.devnull)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, env=environment, timeout=_MAX_TIME, check=False)
    except subprocess.TimeoutExpired:
        raise BagError(f"{path}: it was not read within {_MAX_TIME:g} s") from None
    if done.returncode == _REFUSED:
        raise BagError(done.stdout.decode())
    if done.returncode != 0:
        raise BagError(f"{path}: the process that read it has ended with status {done.returncode}")
    return done.stdout


class _ReportingBag(BagFile):
    """A bag that reports how much of it was read."""

    def __init__(self, path: Path, passes: int, report: Callable[[float], None]) -> None:
        super().__init__(path)
        self._passes, self._begun, self._report = passes, 0, report

    def messages(self, *wanted: str, until: float | None = None) -> Iterator[Message]:
        begun, duration = self._begun, max(self.end - self.start, 1e-9)
        self._begun += 1
        for number, message in enumerate(super().messages(*wanted, until=until)):
            if number % _REPORTED == 0:
                self._report(min(0.99, (begun + (message.time - self.start) / duration) / self._passes))
            yield message


def _runs(run: Run) -> RecordedRuns:
    cell = recorded_cell(run)
    return RecordedRuns(list(cell.runs), goal_indices(cell), cell.goals, recorded_signals(run), run.damage)


def _scene(run: Run) -> RecordedScene:
    found = RecordedScene(run.start, run.robot_descriptions())
    scene = Scene()
    for timed in run.changes() if MONITOR in run.topics.values() else ():
        changes = apply_change(scene, timed.change)
        ends = {eid for subject, _, target in changes.relations for eid in (subject, target)}
        for eid in changes.records.keys() | ends:
            found.elements.append((timed.time, eid, scene.element(eid)))
    for message in run.messages(*_TF):
        found.frames += [(message.time, *item) for item in frames_data(message.content).items()]
    return found


_PARTS: dict[str, Callable[[Run], Any]] = {"runs": _runs, "scene": _scene}


class _Pickler(pickle.Pickler):
    """Writes decoded messages, whose classes exist in the process that reads the bag only, as plain objects."""

    def reducer_override(self, value: Any) -> Any:
        if type(value).__module__ != "rosbags.usertypes":
            return NotImplemented
        return _message, ({each.name: getattr(value, each.name) for each in fields(value)},)


def _message(values: dict[str, Any]) -> SimpleNamespace:
    return SimpleNamespace(**values)


def _dumped(value: Any) -> bytes:
    buffer = io.BytesIO()
    _Pickler(buffer).dump(value)
    return buffer.getvalue()


def main(part: str, path: str, memory: int, progress: str) -> None:
    """Reads a part of a bag, and writes it to the output; with the status `_REFUSED`, why it cannot be read."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, most))
    try:
        with open(progress, "w") as file:

            def report(done: float) -> None:
                file.seek(0)
                file.write(f"{done:.3f}")
                file.flush()

            data = _dumped(_PARTS[part](Run(_ReportingBag(Path(path), _PASSES[part], report))))
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        _refuse(f"{path}: it needs more than {memory / 1024**2:.0f} MB of memory")
    except SkirosError as error:
        _refuse(str(error))
    sys.stdout.buffer.write(data)


def _refuse(text: str) -> NoReturn:
    sys.stdout.buffer.write(text.encode("utf-8", "replace"))
    sys.stdout.flush()
    sys.exit(_REFUSED)


if __name__ == "__main__":
    from skiros2_gateway.core import recorded_bag  # the classes are found by this name when they are read

    recorded_bag.main(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4])
