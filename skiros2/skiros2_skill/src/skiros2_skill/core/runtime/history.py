"""Records of the tasks of a manager, including ended and refused ones."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.params import Param
from skiros2_runs.core.states import TaskState
from skiros2_skill.core.runtime.task import ENDED_SUCCESS, Task

#: How many records of ended and refused tasks are kept.
MAX_RECORDS = 100

#: How many ended tasks are kept with their trees, for inspection.
MAX_TASKS = 5

#: The id of a refused task.
REFUSED = -1


@dataclass(frozen=True)
class Record:
    """The state or the result of a task.

    :param task_id: `REFUSED` for a task that was not started.
    :param author: the client that has requested it.
    :param state: of its root; Idle when it was refused.
    :param code: 1 after success, 0 while it runs, else the progress code of the failure.
    :param message: one line.
    :param explanations: why nodes failed; the failure that ended the task at the end.
    :param preempted: whether it was preempted by a command.
    """

    task_id: int
    author: str
    state: State
    code: int
    message: str
    explanations: list[Explanation] = field(default_factory=list)
    preempted: bool = False

    @property
    def failed(self) -> bool:
        """Whether the task has failed or was refused."""
        return self.state in (State.Failure, State.Idle)

    def to_dict(self) -> dict[str, Any]:
        """The record as JSON data."""
        explanations = [explanation.to_dict() for explanation in self.explanations]
        return {**vars(self), "state": self.state.name, "explanations": explanations}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Record:
        """The record from its JSON data.

        :raises LookupError, TypeError: it is no such data.
        """
        explanations = [Explanation.from_dict(explanation) for explanation in data["explanations"]]
        return cls(**{**data, "state": State[data["state"]], "explanations": explanations})

    def __str__(self) -> str:
        """The record for people, on several lines."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        if self.explanations and self.failed:
            yield self.explanations[-1].sentence
        by = f" by {self.author}" if self.author else ""
        if self.state is State.Idle:
            yield f"a task{by} was refused: {self.message}"
        elif self.state is State.Running:
            runs = f"runs{': nothing has failed' if not self.explanations else ''}"
            yield f"task {self.task_id}{by} {f'is {self.message}' if self.message else runs}"
        else:
            words = "has succeeded" if self.state is State.Success else "has failed"
            message = "" if self.failed and self.explanations else f": {self.message}"
            yield f"task {self.task_id}{by} {words}{message}"
        for explanation in reversed(self.explanations):
            yield from explanation.details()


def record_of(task: Task) -> Record:
    """The record of a task in its present state. Any thread."""
    explanations = task.explanations()
    if not task.ended.is_set():
        return Record(task.id, task.author, State.Running, 0, one_line(task.root.progress_msg), explanations)
    cause = task.cause()
    code = cause.code if cause is not None else task.root.progress_code
    if task.state is State.Success:
        code = ENDED_SUCCESS
    preempted = task.status is TaskState.PREEMPTED
    return Record(task.id, task.author, task.state, code, one_line(task.root.progress_msg), explanations, preempted)


def outputs_of(task: Task) -> dict[str, Param]:
    """The parameters on the blackboard of a task and, where these have no value, those of its skills."""
    params: dict[str, Param] = {}
    for node in task.root.children:
        if node.state is not State.Idle:
            params.update(node.params.getParamMap())
    params.update((key, param) for key, param in task.root.params.getParamMap().items() if param.is_bound())
    return {key: param for key, param in params.items() if param.is_bound()}


def one_line(text: str) -> str:
    """The first line of a text that is not blank."""
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


class History:
    """The running tasks of a manager, and records of the last ended and refused ones. Any thread.

    :param size: how many records are kept.
    :param records: of an earlier process, oldest first.
    """

    def __init__(self, size: int = MAX_RECORDS, records: Iterable[Record] = ()) -> None:
        self._size = size
        self._running: dict[int, Task] = {}
        self._ended: dict[int, Task] = {}
        self._records = [*records]
        self._lock = threading.Lock()

    @property
    def records(self) -> list[Record]:
        """The records, oldest first."""
        with self._lock:
            return [*self._records]

    @property
    def ended(self) -> list[Task]:
        """The last ended tasks, oldest first."""
        with self._lock:
            return [*self._ended.values()]

    def begin(self, task: Task) -> None:
        """Adds a task that is about to start."""
        with self._lock:
            self._running[task.id] = task

    def end(self, task: Task) -> Record:
        """Replaces an ended task by its record.

        :returns: the record.
        """
        record = record_of(task)
        with self._lock:
            if self._running.get(task.id) is task:
                del self._running[task.id]
            self._ended.pop(task.id, None)
            self._ended[task.id] = task
            while len(self._ended) > MAX_TASKS:
                del self._ended[next(iter(self._ended))]
            self._add(record)
        return record

    def task(self, task_id: int) -> Task:
        """The running task with an id, else the last ended one.

        :raises UnknownName: there is none; only the last ended tasks are kept.
        """
        with self._lock:
            task = self._running.get(task_id) or self._ended.get(task_id)
        if task is None:
            raise UnknownName(f"task {task_id} neither runs nor is it among the last {MAX_TASKS} that have ended")
        return task

    def refuse(self, record: Record, task: Task | None = None) -> None:
        """Adds the record of a refused task.

        :param task: was added by `begin`, and is removed.
        """
        with self._lock:
            if task is not None and self._running.get(task.id) is task:
                del self._running[task.id]
            self._add(record)

    def get(self, task_id: int) -> Record:
        """The record of the last task with an id.

        :param task_id: -1: the last task that failed or was refused.
        :raises UnknownName: there is none.
        """
        with self._lock:
            task = self._running.get(task_id)
            records = self._records[::-1]
        if task is not None:
            return record_of(task)
        for record in records:
            if record.task_id == task_id >= 0 or (task_id < 0 and record.failed):
                return record
        if task_id < 0:
            raise UnknownName("no task has failed or was refused")
        raise UnknownName(f"task {task_id} neither runs nor is it among the last {self._size} that have ended")

    def _add(self, record: Record) -> None:
        self._records.append(record)
        del self._records[: -self._size]
