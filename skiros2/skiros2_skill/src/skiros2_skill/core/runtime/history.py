"""What became of the tasks of a manager, also of those that were refused: for those who ask why."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import PREEMPT, Explanation
from skiros2_skill.core.runtime.task import ENDED_SUCCESS, Task

#: So many tasks that have ended or were refused are kept, the last ones.
MOST_KEPT = 100

#: The id of a task that was refused.
REFUSED = -1


@dataclass(frozen=True)
class Record:
    """What is known of a task.

    :param task_id: `REFUSED` for one that was not started.
    :param author: who asked for it.
    :param state: that of its root; Idle when it was refused.
    :param code: 1 after success, else the progress code of what made it fail; 0 while it runs.
    :param message: in one line.
    :param explanations: why nodes failed, the one that failed last at the end.
    :param preempted: whether it was ended from outside.
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
        """Whether it has failed or was refused."""
        return self.state in (State.Failure, State.Idle)

    def __str__(self) -> str:
        """For people, in several lines."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        by = f" by {self.author}" if self.author else ""
        if self.state is State.Idle:
            yield f"a task{by} was refused: {self.message}"
        elif self.state is State.Running:
            yield f"task {self.task_id}{by} runs{': nothing has failed' if not self.explanations else ''}"
        else:
            words = "has succeeded" if self.state is State.Success else "has failed"
            yield f"task {self.task_id}{by} {words}: {self.message}"
        for explanation in self.explanations:
            yield from explanation.lines()


def record_of(task: Task) -> Record:
    """What is known of a task now. Any thread."""
    explanations = task.explanations()
    if not task.ended.is_set():
        return Record(task.id, task.author, State.Running, 0, one_line(task.root.progress_msg), explanations)
    cause = task.cause()
    code = cause.code if cause is not None else task.root.progress_code
    if task.state is State.Success:
        code = ENDED_SUCCESS
    preempted = cause is not None and cause.stage == PREEMPT and task.state is not State.Success
    return Record(task.id, task.author, task.state, code, one_line(task.root.progress_msg), explanations, preempted)


def one_line(text: str) -> str:
    """The first line of a text, which says what there is to say."""
    return next((line.strip() for line in text.splitlines() if line.strip()), "")


class History:
    """The tasks of a manager that run, and the last ones that have ended or were refused. Any thread."""

    def __init__(self, kept: int = MOST_KEPT) -> None:
        self._most = kept
        self._running: dict[int, Task] = {}
        self._kept: list[Record] = []
        self._lock = threading.Lock()

    def begin(self, task: Task) -> None:
        """A task is to run."""
        with self._lock:
            self._running[task.id] = task

    def end(self, task: Task) -> Record:
        """A task has ended.

        :returns: what is kept of it.
        """
        record = record_of(task)
        with self._lock:
            if self._running.get(task.id) is task:
                del self._running[task.id]
            self._keep(record)
        return record

    def refuse(self, record: Record) -> None:
        """A task was not started."""
        with self._lock:
            self._keep(record)

    def get(self, task_id: int) -> Record:
        """What is known of the task with that id; of several that had it, the last one.

        :param task_id: -1: the task that failed or was refused last.
        :raises UnknownName: there is none.
        """
        with self._lock:
            task = self._running.get(task_id)
            kept = self._kept[::-1]
        if task is not None:
            return record_of(task)
        for record in kept:
            if record.task_id == task_id >= 0 or (task_id < 0 and record.failed):
                return record
        if task_id < 0:
            raise UnknownName("no task has failed or was refused")
        raise UnknownName(f"task {task_id} neither runs nor is it among the last {self._most} that have ended")

    def _keep(self, record: Record) -> None:
        self._kept.append(record)
        del self._kept[: -self._most]
