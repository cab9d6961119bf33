"""Runs of tasks, of their nodes and of skills, from the progress that skill managers published."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import Message
from skiros2_bags.core.tolerance import GROUP_TYPE, ROOT_TYPE

#: Names of the states in `SkillProgress`.
STATES = {1: "Success", 2: "Failure", 3: "Running", 4: "Idle"}
SUCCESS, FAILURE, RUNNING, IDLE = STATES

#: Longest time between two progress messages of a running node (s), with a margin; managers publish once a second.
_MAX_REPORT_INTERVAL = 1.5


@dataclass(frozen=True)
class NodeState:
    """The state of a node from a time on.

    :param time: when it was recorded (s since the epoch).
    :param state: `SUCCESS`, `FAILURE`, `RUNNING` or `IDLE`.
    """

    time: float
    state: int
    code: int
    message: str


@dataclass
class NodeRun:
    """The run of a node of a task.

    :param depth: 0 for the root of the task.
    :param states: oldest first; each differs from the previous one.
    """

    id: int
    parent_id: int
    depth: int
    type: str
    label: str
    processor: str
    states: list[NodeState] = field(default_factory=list)

    @property
    def state(self) -> int:
        """The last state."""
        return self.states[-1].state

    @property
    def name(self) -> str:
        """"root" for a root; the type of a group and of a node without label; else the label."""
        if self.type == ROOT_TYPE:
            return "root"
        return self.label if self.label and self.type != GROUP_TYPE else self.type

    def state_changes(self) -> list[NodeState]:
        """Returns the states that differ from the previous one in more than code and message."""
        return [s for before, s in zip([None, *self.states], self.states, strict=False)
                if before is None or before.state != s.state]  # fmt: skip


@dataclass
class TaskRun:
    """The run of a task on a skill manager.

    :param robot: the manager's name, with its leading slash.
    :param start: time of its first progress message (s since the epoch).
    :param end: time of its last progress message.
    :param nodes: by id, each after its parent, the root first. Includes children that were removed later.
    :param is_complete: whether the bag contains its first progress message.
    """

    robot: str
    id: int
    start: float
    end: float
    nodes: dict[int, NodeRun] = field(default_factory=dict)
    is_complete: bool = True

    @property
    def root(self) -> NodeRun:
        return self.nodes[self.id]

    @property
    def has_ended(self) -> bool:
        """Whether the bag contains its last progress message."""
        return abs(self.root.states[-1].code) == 1

    @property
    def message(self) -> str:
        """The last message of the root."""
        return self.root.states[-1].message

    def path(self, node: NodeRun) -> tuple[str, ...]:
        """Returns the names of the nodes from the child of the root to the given node."""
        names: list[str] = []
        while node.depth > 0:
            names.append(node.name)
            node = self.nodes[node.parent_id]
        return tuple(reversed(names))


def task_runs(messages: Iterable[Message]) -> list[TaskRun]:
    """Returns the tasks of all managers, ordered by start.

    :param messages: of the type `TreeProgress`, oldest first.
    :raises BagError: a message cannot be read.
    """
    tasks: list[TaskRun] = []
    current: dict[tuple[str, int], TaskRun] = {}
    for message in messages:
        progress = message.content.progress
        if not progress:
            continue
        first = progress[0]
        key = (first.robot or message.topic.removesuffix("/monitor"), first.task_id)
        task = current.get(key)
        is_over = abs(first.progress_code) == 1
        if task is None or (task.has_ended and not is_over):  # a restarted manager counts from 0 again
            task = current[key] = TaskRun(*key, message.time, message.time, is_complete=_is_start(progress))
            tasks.append(task)
        _add_progress(task, progress, message)
    return tasks


def _add_progress(task: TaskRun, progress: list[Any], message: Message) -> None:
    task.end = message.time
    if progress[0].id != task.id:
        begin = f"begins with node {progress[0].id}, expected its root"
        raise BagError(f"{message.location}: the progress of task {task.id} {begin}")
    for report in progress:
        node = task.nodes.get(report.id)
        if node is None:
            parent = task.nodes.get(report.parent_id)
            depth = parent.depth + 1 if parent is not None and report.id != task.id else 0
            node = NodeRun(report.id, report.parent_id, depth, report.type, report.label, report.processor)
            task.nodes[report.id] = node
        elif report.label != node.label or report.processor != node.processor:  # set when the skill is selected
            node.type, node.label, node.processor = report.type, report.label, report.processor
        state = (report.state, report.progress_code, report.progress_message)
        if not node.states or (node.states[-1].state, node.states[-1].code, node.states[-1].message) != state:
            node.states.append(NodeState(message.time, *state))


def _is_start(progress: list[Any]) -> bool:
    """Whether a progress message can be that of the first tick of a task."""
    return all(node.progress_time < _MAX_REPORT_INTERVAL for node in progress)


@dataclass(frozen=True)
class SkillRun:
    """One run of a skill within a task.

    :param start: first time with state `RUNNING` (s since the epoch); the end, if it ended in its first tick.
    :param end: time of its end; of the last progress message, for a task that did not end.
    :param state: `SUCCESS` or `FAILURE`; `RUNNING` for a run that did not end, `IDLE` for a stopped one.
    :param path: the names of its ancestors from the child of the root, and its own.
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
        """Depth of its node; 1 for the skills of the task request."""
        return len(self.path)

    @property
    def duration(self) -> float:
        """s."""
        return self.end - self.start

    @property
    def state_name(self) -> str:
        return STATES.get(self.state, str(self.state))


def skill_runs(tasks: Iterable[TaskRun]) -> list[SkillRun]:
    """Returns the runs of all skills, ordered by start; each after the run of its parent."""
    runs = [run for task in tasks for node in task.nodes.values() if node.depth > 0 for run in _runs(task, node)]
    return sorted(runs, key=lambda run: (run.start, run.robot, run.task_id, run.node_id))


def _runs(task: TaskRun, node: NodeRun) -> Iterator[SkillRun]:
    start: float | None = None
    for number, report in enumerate(node.states):
        before = node.states[number - 1].state if number else None
        if report.state == RUNNING:
            start = report.time if start is None else start
            continue
        has_ended = report.state in (SUCCESS, FAILURE) and before != report.state
        if has_ended or start is not None:
            begun = report.time if start is None else start
            yield _run(task, node, begun, report.time, report.state, report.code, report.message)
        start = None
    if start is not None:
        last = node.states[-1]
        yield _run(task, node, start, task.end, last.state, last.code, last.message)


def _run(task: TaskRun, node: NodeRun, start: float, end: float, state: int, code: int, message: str) -> SkillRun:
    path = task.path(node)
    return SkillRun(task.robot, task.id, node.id, path, node.name, node.type, start, end, state, code, message)
