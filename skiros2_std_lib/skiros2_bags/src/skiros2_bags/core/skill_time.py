"""When each skill ran, from the traces of tasks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from skiros2_bags.core.task_trace import FAILURE, RUNNING, STATES, SUCCESS, NodeTrace, TaskTrace


@dataclass(frozen=True)
class SkillTime:
    """One run of a skill; a skill that is repeated has several.

    :param start: when it was first told to run (s since the epoch); when its end was told, if it had ended by then.
    :param end: when its end was told, or the last that was told of a task that did not end.
    :param state: `SUCCESS` or `FAILURE`; `RUNNING` when it was still running; `IDLE` when it was stopped.
    :param path: the names of the skills that it is a part of, from the one that the task names, and its own.
    """

    robot: str
    task_id: int
    node_id: int
    path: tuple[str, ...]
    label: str
    type: str
    start: float
    end: float
    state: int
    code: int
    message: str

    @property
    def depth(self) -> int:
        """Of its node; skills that the task itself names have 1."""
        return len(self.path)

    @property
    def duration(self) -> float:
        """s."""
        return self.end - self.start

    @property
    def state_name(self) -> str:
        return STATES.get(self.state, str(self.state))


def skill_times(tasks: Iterable[TaskTrace]) -> list[SkillTime]:
    """The runs of all skills, by task, each after that of the skill it is a part of; ordered by start."""
    runs = [run for task in tasks for node in task.nodes.values() if node.depth > 0 for run in _runs(task, node)]
    return sorted(runs, key=lambda run: (run.start, run.robot, run.task_id, run.node_id))


def _runs(task: TaskTrace, node: NodeTrace) -> Iterator[SkillTime]:
    start: float | None = None
    for number, told in enumerate(node.states):
        before = node.states[number - 1].state if number else None
        if told.state == RUNNING:
            start = told.time if start is None else start
            continue
        has_ended = told.state in (SUCCESS, FAILURE) and before != told.state
        if has_ended or start is not None:
            begun = told.time if start is None else start
            yield _run(task, node, begun, told.time, told.state, told.code, told.message)
        start = None
    if start is not None:
        last = node.states[-1]
        yield _run(task, node, start, task.end, last.state, last.code, last.message)


def _run(task: TaskTrace, node: NodeTrace, start: float, end: float, state: int, code: int, message: str) -> SkillTime:
    path = task.path(node)
    return SkillTime(task.robot, task.id, node.id, path, node.name, node.type, start, end, state, code, message)
