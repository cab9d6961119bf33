"""The states of each node of a task over time, and the runs of its skills."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from skiros2_runs.core.frame import Frame
from skiros2_runs.core.states import ENDS, RUNNING
from skiros2_runs.core.task_run import TaskRun


@dataclass(frozen=True)
class NodeReport:
    """The progress of a node from a time on.

    :param time: s since the epoch.
    :param state: a `NodeState`, or an unknown value.
    """

    time: float
    state: int
    code: int
    message: str


@dataclass
class NodeHistory:
    """A node of a task over time.

    :param parent_id: of its parent in the tree; -1 for the root.
    :param depth: 0 for the root.
    :param path: the names from below the root to the node.
    :param index_path: the child indices from the root to the node; () for the root.
    :param reports: oldest first; each differs from the previous one.
    """

    id: int
    parent_id: int
    depth: int
    type: str
    label: str
    processor: str
    name: str
    path: tuple[str, ...]
    index_path: tuple[int, ...]
    reports: list[NodeReport] = field(default_factory=list)

    @property
    def state(self) -> int:
        """The last state."""
        return self.reports[-1].state

    def state_changes(self) -> list[NodeReport]:
        """Returns the reports that differ from the previous one in more than code and message."""
        return [
            report
            for before, report in zip([None, *self.reports], self.reports, strict=False)
            if before is None or before.state != report.state
        ]


def node_histories(run: TaskRun) -> dict[int, NodeHistory]:
    """Returns the nodes of a task by id, each after its parent, the root first. Includes nodes that were removed."""
    nodes: dict[int, NodeHistory] = {}
    before: Frame | None = None
    for frame in run.frames():
        shape = frame.shape
        is_new = before is None or before.shape is not shape
        for index in range(len(shape)):
            if is_new:
                _describe(nodes, frame, index)
            elif before is not None and frame.report(index) == before.report(index):
                continue
            reports, report = nodes[shape.id(index)].reports, frame.report(index)
            last = reports[-1] if reports else None
            if last is None or (last.state, last.code, last.message) != report:
                reports.append(NodeReport(frame.time, *report))
        before = frame
    return nodes


def _describe(nodes: dict[int, NodeHistory], frame: Frame, index: int) -> None:
    """Adds a node, or updates its label and processor, which are known when its implementation is selected."""
    shape = frame.shape
    parent = shape.parents[index]
    node = NodeHistory(
        shape.id(index),
        shape.id(parent) if parent >= 0 else -1,
        shape.depths[index],
        shape.type(index),
        shape.label(index),
        shape.processor(index),
        shape.name(index) if index else "root",
        tuple(shape.path_names(index)),
        shape.index_paths[index],
    )
    known = nodes.get(node.id)
    if known is not None:
        node.reports = known.reports
    nodes[node.id] = node


@dataclass(frozen=True)
class SkillRecord:
    """One run of a skill within a task.

    :param start: first time with state `RUNNING` (s since the epoch); the end, if it ended in its first tick.
    :param end: time of its end; of the task's last message, for a run that did not end.
    :param state: `SUCCESS` or `FAILURE`; `RUNNING` for a run that did not end, `IDLE` for a stopped one.
    :param path: the names of its ancestors from below the root, and its own.
    """

    robot: str
    task_id: int
    node_id: int
    path: tuple[str, ...]
    type: str
    start: float
    end: float
    state: int
    code: int
    message: str

    @property
    def label(self) -> str:
        """The name of its node."""
        return self.path[-1]

    @property
    def depth(self) -> int:
        """Depth of its node; 1 for the skills of the task request."""
        return len(self.path)

    @property
    def duration(self) -> float:
        """s."""
        return self.end - self.start


def skill_runs(tasks: Iterable[TaskRun]) -> list[SkillRecord]:
    """Returns the runs of all skills and groups, ordered by start; each after the run of its parent."""
    runs = [run for task in tasks for node in node_histories(task).values() if node.path for run in _runs(task, node)]
    return sorted(runs, key=lambda run: (run.start, run.robot, run.task_id, run.depth, run.node_id))


def _runs(task: TaskRun, node: NodeHistory) -> Iterator[SkillRecord]:
    start: float | None = None
    before: int | None = None
    for report in node.reports:
        if report.state == RUNNING:
            start = report.time if start is None else start
        else:
            if start is not None or (report.state in ENDS and before != report.state):
                yield _run(task, node, start, report, report.time)
            start = None
        before = report.state
    if start is not None:
        yield _run(task, node, start, node.reports[-1], task.latest.time)


def _run(task: TaskRun, node: NodeHistory, start: float | None, last: NodeReport, end: float) -> SkillRecord:
    begun = end if start is None else start
    return SkillRecord(
        task.robot, task.task_id, node.id, node.path, node.type, begun, end, last.state, last.code, last.message
    )
