"""What each node of a task did, from the progress that its manager told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.message import Message
from skiros2_bags.core.normal import GROUP_TYPE, ROOT_TYPE

#: The names of the states on the wire.
STATES = {1: "Success", 2: "Failure", 3: "Running", 4: "Idle"}
SUCCESS, FAILURE, RUNNING, IDLE = STATES

#: Who has run for so long (s) must have told so before.
_LATE = 1.5


@dataclass(frozen=True)
class NodeState:
    """What a node was told to be from a time on.

    :param time: when that was recorded (s since the epoch).
    :param state: `SUCCESS`, `FAILURE`, `RUNNING` or `IDLE`.
    """

    time: float
    state: int
    code: int
    message: str


@dataclass
class NodeTrace:
    """A node of a task: a skill, or what its tree is made of.

    :param depth: 0 for the task's root.
    :param states: oldest first; each differs from the one before.
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
        """The label; "root" for a root; the type of a group and of a node without label."""
        if self.type == ROOT_TYPE:
            return "root"
        return self.label if self.label and self.type != GROUP_TYPE else self.type

    def state_changes(self) -> list[NodeState]:
        """The states without those that have only another code or message than the one before."""
        return [s for before, s in zip([None, *self.states], self.states, strict=False)
                if before is None or before.state != s.state]  # fmt: skip


@dataclass
class TaskTrace:
    """A task of a skill manager.

    :param robot: the manager's name, with its leading slash.
    :param start: when its first progress was recorded (s since the epoch).
    :param end: when the last one was.
    :param nodes: by id, each after its parent; the root first. Children that a node had for a while stay.
    :param is_whole: whether its first progress is in the bag; not when it was running before that.
    """

    robot: str
    id: int
    start: float
    end: float
    nodes: dict[int, NodeTrace] = field(default_factory=dict)
    is_whole: bool = True

    @property
    def root(self) -> NodeTrace:
        return self.nodes[self.id]

    @property
    def has_ended(self) -> bool:
        """Whether its end was told."""
        return abs(self.root.states[-1].code) == 1

    @property
    def message(self) -> str:
        """What its root said last."""
        return self.root.states[-1].message

    def path(self, node: NodeTrace) -> tuple[str, ...]:
        """The names of the nodes from below the root to one."""
        names: list[str] = []
        while node.depth > 0:
            names.append(node.name)
            node = self.nodes[node.parent_id]
        return tuple(reversed(names))


def task_traces(messages: Iterable[Message]) -> list[TaskTrace]:
    """The tasks of all managers, in the order in which they began.

    :param messages: of the type `TreeProgress`, oldest first.
    :raises BagError: one cannot be read.
    """
    tasks: list[TaskTrace] = []
    current: dict[tuple[str, int], TaskTrace] = {}
    for message in messages:
        progress = message.content.progress
        if not progress:
            continue
        first = progress[0]
        key = (first.robot or message.topic.removesuffix("/monitor"), first.task_id)
        task = current.get(key)
        is_over = abs(first.progress_code) == 1
        if task is None or (task.has_ended and not is_over):  # numbers come again when a manager was started anew
            task = current[key] = TaskTrace(*key, message.time, message.time, is_whole=_is_start(progress))
            tasks.append(task)
        _enter(task, progress, message)
    return tasks


def _enter(task: TaskTrace, progress: list[Any], message: Message) -> None:
    task.end = message.time
    if progress[0].id != task.id:
        begin = f"begins with node {progress[0].id}, expected its root"
        raise BagError(f"{message.place}: the progress of task {task.id} {begin}")
    for told in progress:
        node = task.nodes.get(told.id)
        if node is None:
            above = task.nodes.get(told.parent_id)
            depth = above.depth + 1 if above is not None and told.id != task.id else 0
            node = NodeTrace(told.id, told.parent_id, depth, told.type, told.label, told.processor)
            task.nodes[told.id] = node
        elif told.label != node.label or told.processor != node.processor:  # known only once the skill was chosen
            node.type, node.label, node.processor = told.type, told.label, told.processor
        state = (told.state, told.progress_code, told.progress_message)
        if not node.states or (node.states[-1].state, node.states[-1].code, node.states[-1].message) != state:
            node.states.append(NodeState(message.time, *state))


def _is_start(progress: list[Any]) -> bool:
    """Whether a first progress can be that of a task's first tick: progress is told once a second at least."""
    return all(node.progress_time < _LATE for node in progress)
