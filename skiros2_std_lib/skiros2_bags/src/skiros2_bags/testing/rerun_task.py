"""A recorded task that is ticked again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.fake_action_clients import StatesOf
from skiros2_bags.testing.recorded_task import RecordedTask
from skiros2_bags.testing.recording import TaskProgress
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.params import ParamTypes
from skiros2_common.ros import utils
from skiros2_runs.core.compare import CONTEXT, first_difference, path_text, report_text
from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_runs.core.tolerance import Tolerance
from skiros2_skill.core.runtime.request import SkillRequest, make_nodes
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.messages import progress_messages
from skiros2_world_model.core.changes import Change

#: Period of a manager's ticks (s); most ticks publish no progress.
_PERIOD = 0.04


class RerunTask:
    """A task, created like the manager created it.

    :param manager: the `RerunManager`.
    :raises BagError: the bag does not contain the request.
    """

    def __init__(self, run: RecordedTask, manager: Any, tolerance: Tolerance) -> None:
        self.run = run
        self._manager = manager
        self._tolerance = tolerance
        #: The last recorded progress.
        self.progress: TaskProgress = run.progress[0]
        self._due_changes: list[Change] = []
        self._rejection = ""
        try:
            nodes = make_nodes(_requests(run), manager.library, manager.wmi)
        except Refused as error:
            nodes, self._rejection = [], str(error)
        self._task = Task(run.run.task_id, manager.wmi, run.manager)
        self._task.root.params.addParam("Robot", manager.robot, ParamTypes.Inferred, "The manager's robot")
        self._task.root(*nodes)

    def preempt(self) -> None:
        """Requests preemption of the task."""
        self._task.preempt()

    def tick(self, progress: TaskProgress, due_changes: Sequence[Change]) -> tuple[str, str, str] | None:
        """Ticks until there is progress to publish, at most as often as the manager can have ticked.

        :param due_changes: the recorded changes that this tick may make.
        :returns: a mismatch (node, recorded, now); None without one.
        """
        if self._rejection:
            return "the task is refused", "it runs", self._rejection
        before, self.progress, self._due_changes = self.progress, progress, list(due_changes)
        state = progress.frame.task_state
        if state is TaskState.PAUSED:
            return None
        if state is TaskState.PREEMPTED and self._task.preempted_at is None:
            self._task.preempt()  # requested by a command, which bags do not contain
        self._manager.ticked = self
        try:
            for _ in range(2 + int((progress.time - before.time) / _PERIOD)):
                self._task.tick()
                if self._task.update_revision() or self._task.ended.is_set():
                    break
        finally:
            self._manager.ticked = None
        return self._diff(progress)

    def states_between(self, progress: TaskProgress) -> StatesOf:
        """Returns a function that returns the recorded nodes of a skill instance before and after a tick."""
        before, now = self.progress.frame.nodes, progress.frame.nodes
        paths = {id(getattr(node, "instance", None)): path for path, node in _index_paths(self._task.root)}

        def nodes(skill: Any) -> tuple[NodeProgress | None, NodeProgress | None]:
            path = paths.get(id(skill)) if skill is not None else None
            return (before.get(path), now.get(path)) if path is not None else (None, None)

        return nodes

    def recorded_node(self, skill: Any) -> NodeProgress | None:
        """Returns the recorded node of a skill instance in the current tick."""
        for path, node in _index_paths(self._task.root):
            if getattr(node, "instance", None) is skill:
                return self.progress.frame.nodes.get(path)
        return None

    def take_due_changes(self) -> list[Change]:
        """Returns the due changes that were not made yet, and clears them."""
        due_changes, self._due_changes = self._due_changes, []
        return due_changes

    def context(self, progress: TaskProgress) -> tuple[str, ...]:
        """Returns the recorded state changes before a progress message, one line each."""
        index = self.run.progress.index(progress)
        lines: list[str] = []
        for number in range(max(1, index - CONTEXT), index):
            before, now = self.run.progress[number - 1].frame.nodes, self.run.progress[number].frame.nodes
            changed = [n for path, n in now.items() if path not in before or _report(before[path]) != _report(n)]
            lines += [f"tick {number + 1}: {path_text(n.path)}: {report_text(*_report(n))}" for n in changed]
        return tuple(lines[-2 * CONTEXT :])

    def _diff(self, progress: TaskProgress) -> tuple[str, str, str] | None:
        now = TaskRun(self.run.manager, self.run.run.task_id)
        now.record(progress_messages(self._task, self.run.manager), progress.time)
        wanted, found = progress.frame.nodes, now.latest.nodes
        path = first_difference(wanted, found, self._tolerance)
        if path is None:
            return None
        nodes = [tree.get(path) for tree in (wanted, found)]
        there = [node for node in nodes if node is not None]
        has_other_name = len({node.name for node in there}) > 1
        texts = ["no such node" if node is None else _node_text(node, has_other_name) for node in nodes]
        return path_text(there[0].path), texts[0], texts[1]


def _node_text(node: NodeProgress, with_name: bool) -> str:
    text = report_text(*_report(node))
    return f"{node.name}: {text}" if with_name else text


def _report(node: NodeProgress) -> tuple[int, int, str]:
    return node.state, node.code, node.message


def _requests(run: RecordedTask) -> list[SkillRequest]:
    """Returns the requested skills.

    :raises BagError: the bag does not contain the request.
    """
    if run.skills:
        return [SkillRequest(s.type, s.name, utils.deserializeParamMap(s.params)) for s in run.skills]
    shape = run.progress[0].frame.shape
    recorded = {index: run.run.params.get(shape.id(index)) for index in shape.children[0]}
    params = {index: history[0][1] if history else () for index, history in recorded.items()}
    if not any(params.values()):
        raise BagError(
            f"{run}: the bag has neither the goal that requested it nor its parameters; expected a goal on "
            f"{run.manager}/execute or, for a task that was started by service, progress with parameters "
            f"({run.manager}/set_debug)"
        )
    try:
        return [
            SkillRequest(shape.type(index), shape.label(index), utils.deserializeParamMap(list(map(_Text, texts))))
            for index, texts in params.items()
        ]
    except SkirosError as error:
        raise BagError(f"{run}: its recorded parameters cannot be read: {error}") from error


class _Text:
    """Stands in for a `Param` message."""

    def __init__(self, param: str) -> None:
        self.param = param


def _index_paths(root: Any) -> list[tuple[tuple[int, ...], Any]]:
    """Returns the nodes of a tree with their index paths, each before its children."""
    found = []
    waiting: list[tuple[tuple[int, ...], Any]] = [((), root)]
    while waiting:
        index_path, node = waiting.pop()
        found.append((index_path, node))
        waiting += [((*index_path, index), child) for index, child in enumerate(node.children)][::-1]
    return found
