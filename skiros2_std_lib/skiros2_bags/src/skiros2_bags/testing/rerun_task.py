"""A recorded task that is ticked again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.tolerance import Tolerance
from skiros2_bags.testing.divergence import CONTEXT, first_difference, node_text, path_of
from skiros2_bags.testing.fake_action_clients import StatesOf
from skiros2_bags.testing.recorded_task import RecordedTask
from skiros2_bags.testing.recording import NodeProgress, TaskProgress
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.params import ParamTypes
from skiros2_common.ros import utils
from skiros2_skill.core.runtime.request import SkillRequest, make_nodes
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.progress import wire_code, wire_text
from skiros2_world_model.core.changes import Change

_LETTERS = {State.Success: "S", State.Failure: "F", State.Running: "R"}

#: Period of a manager's ticks (s); most ticks publish no progress.
_PERIOD = 0.04

#: Starts of the messages of a paused task's root.
_PAUSED = ("paused", "breakpoint")


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
        self._task = Task(run.task, manager.wmi, run.manager)
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
        if progress.nodes[0].state == "R" and progress.nodes[0].message.startswith(_PAUSED):
            return None
        if progress.nodes[0].message.startswith("Preempted") and self._task.preempted_at is None:
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
        before, now = ({node.index_path: node for node in message.nodes} for message in (self.progress, progress))
        paths = {id(getattr(node, "_instance", None)): path for path, node in _index_paths(self._task.root)}

        def nodes(skill: Any) -> tuple[NodeProgress | None, NodeProgress | None]:
            path = paths.get(id(skill)) if skill is not None else None
            return (before.get(path), now.get(path)) if path is not None else (None, None)

        return nodes

    def recorded_node(self, skill: Any) -> NodeProgress | None:
        """Returns the recorded node of a skill instance in the current tick."""
        for path, node in _index_paths(self._task.root):
            if getattr(node, "_instance", None) is skill:
                return next((recorded for recorded in self.progress.nodes if recorded.index_path == path), None)
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
            before, now = self.run.progress[number - 1], self.run.progress[number]
            known = {node.index_path: node for node in before.nodes}
            changed = [node for node in now.nodes if known.get(node.index_path) != node]
            lines += [f"tick {number + 1}: {path_of(now.nodes, n.index_path)}: {node_text(n)}" for n in changed]
        return tuple(lines[-2 * CONTEXT :])

    def _diff(self, progress: TaskProgress) -> tuple[str, str, str] | None:
        got = self._current_nodes()
        path = first_difference(progress.nodes, got, self._tolerance)
        if path is None:
            return None
        wanted, found = (next((n for n in nodes if n.index_path == path), None) for nodes in (progress.nodes, got))
        named = wanted is not None and found is not None and wanted.name != found.name
        texts = [f"{n.name}: {node_text(n)}" if n is not None and named else node_text(n) for n in (wanted, found)]
        return path_of(progress.nodes if wanted is not None else got, path), texts[0], texts[1]

    def _current_nodes(self) -> list[NodeProgress]:
        paths = {id(node): path for path, node in _index_paths(self._task.root)}
        by_id = {node._id: paths[id(node)] for _, node in _index_paths(self._task.root)}
        progress = self._task.progress()
        by_id.update({node._id: paths[id(node)] for _, node in _index_paths(self._task.root)})
        return [
            NodeProgress(
                by_id[node.id], wire_text(node.type), wire_text(node.label), node.processor,
                _LETTERS.get(node.state, "."), wire_code(node.progress_code), wire_text(node.progress_message),
                node.progress_time,
            )
            for node in progress
        ]  # fmt: skip


def _requests(run: RecordedTask) -> list[SkillRequest]:
    """Returns the requested skills.

    :raises BagError: the bag does not contain the request.
    """
    if run.skills:
        return [SkillRequest(s.type, s.name, utils.deserializeParamMap(s.params)) for s in run.skills]
    roots = [node for node in run.progress[0].nodes if len(node.index_path) == 1]
    if not any(node.params for node in roots):
        raise BagError(
            f"{run}: the bag has neither the goal that requested it nor its parameters; expected a goal on "
            f"{run.manager}/execute or, for a task that was started by service, progress with parameters "
            f"({run.manager}/set_debug)"
        )
    try:
        return [
            SkillRequest(node.type, node.label, utils.deserializeParamMap([_Text(text) for text in node.params]))
            for node in roots
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
