"""Bags are read in a process of their own: one that was made to harm ends that process, and not the gateway.

`python3 -m skiros2_gateway.core.recorded_bag PART PATH BYTES` writes the part (`runs` or `scene`) of a bag to its
output; it takes at most so much memory.
"""

from __future__ import annotations

import io
import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from skiros2_bags.core.bag_file import MONITOR, BagError
from skiros2_bags.core.recorded_cell import goal_indices, recorded_cell
from skiros2_bags.core.recorded_signals import recorded_signals
from skiros2_bags.core.run import Run
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_live.core.scene_view import frames_data
from skiros2_runs.core.task_run import TaskRun
from skiros2_world_model.core.replica import apply_change
from skiros2_world_model.core.scene import Scene

#: The most memory (bytes) and time (s) for reading a bag.
MAX_MEMORY = 2 * 1024**3
_MAX_TIME = 300.0

_TF = ("/tf", "/tf_static")


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


def read_runs(path: Path) -> RecordedRuns:
    """Reads the runs of a bag. Blocks.

    :raises BagError: it cannot be read within the limits of memory and time.
    """
    runs = _read("runs", path)
    assert isinstance(runs, RecordedRuns)
    return runs


def read_scene(path: Path) -> RecordedScene:
    """Reads the scene in a bag. Blocks; raises like `read_runs`."""
    scene = _read("scene", path)
    assert isinstance(scene, RecordedScene)
    return scene


def _read(part: str, path: Path) -> Any:
    command = [sys.executable, "-m", __name__, part, str(path), str(MAX_MEMORY)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, env=environment, timeout=_MAX_TIME, check=False)
    except subprocess.TimeoutExpired:
        raise BagError(f"{path}: it was not read within {_MAX_TIME:g} s") from None
    if done.returncode != 0:
        raise BagError(f"{path}: the process that read it has ended with status {done.returncode}")
    found = pickle.loads(done.stdout)
    if isinstance(found, str):
        raise BagError(found)
    return found


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


def main(part: str, path: str, memory: int) -> None:
    """Reads a part of a bag, and writes it to the output; a text says why it cannot be read."""
    _, most = resource.getrlimit(resource.RLIMIT_DATA)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, most))
    try:
        data = _dumped(_PARTS[part](Run.open(path)))
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))
        data = pickle.dumps(f"{path}: it needs more than {memory / 1024**2:.0f} MB of memory")
    except SkirosError as error:
        data = pickle.dumps(str(error))
    sys.stdout.buffer.write(data)


if __name__ == "__main__":
    from skiros2_gateway.core import recorded_bag  # the classes are found by this name when they are read

    recorded_bag.main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
