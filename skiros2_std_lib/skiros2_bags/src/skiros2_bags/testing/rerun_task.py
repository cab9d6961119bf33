"""One task of a recording, ticked again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from skiros2_bags.core.errors import BagError
from skiros2_bags.core.normal import Tolerance
from skiros2_bags.testing.divergence import CONTEXT, first_difference, node_text, path_of
from skiros2_bags.testing.recording import Seen, Told
from skiros2_bags.testing.task_runs import TaskRun
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_common.core.params import ParamTypes
from skiros2_common.ros import utils
from skiros2_skill.core.runtime.request import SkillRequest, make_nodes
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.progress import wire_code, wire_text
from skiros2_world_model.core.changes import Change

_LETTERS = {State.Success: "S", State.Failure: "F", State.Running: "R"}

#: The period of a manager's ticks (s), for those in which nothing was told.
_PERIOD = 0.04

#: What a root tells when its task does not go on.
_PAUSED = ("paused", "breakpoint")


class RerunTask:
    """A task, made as its manager has made it.

    :param manager: the `RerunManager`.
    :raises BagError: the bag does not have what was asked for.
    """

    def __init__(self, run: TaskRun, manager: Any, tolerance: Tolerance) -> None:
        self.run = run
        self._manager = manager
        self._tolerance = tolerance
        #: What was told last.
        self.told: Told = run.told[0]
        self._due: list[Change] = []
        self._refusal = ""
        try:
            nodes = make_nodes(_requests(run), manager.library, manager.wmi)
        except Refused as error:
            nodes, self._refusal = [], str(error)
        self._task = Task(run.task, manager.wmi, run.manager)
        self._task.root.params.addParam("Robot", manager.robot, ParamTypes.Inferred, "The manager's robot")
        self._task.root(*nodes)

    def preempt(self) -> None:
        """Asks the task to end."""
        self._task.preempt()

    def tick(self, told: Told, due: Sequence[Change]) -> tuple[str, str, str] | None:
        """Ticks until something is to be told, at most as often as the manager can have.

        :param due: the recorded changes that this tick may make.
        :returns: what is not as recorded: the node, as recorded, and now.
        """
        if self._refusal:
            return "the task is refused", "it runs", self._refusal
        before, self.told, self._due = self.told, told, list(due)
        if told.nodes[0].state == "R" and told.nodes[0].message.startswith(_PAUSED):
            return None
        if told.nodes[0].message.startswith("Preempted") and self._task.preempted_at is None:
            self._task.preempt()  # by a command, which no bag has
        self._manager.ticked = self
        try:
            for _ in range(2 + int((told.time - before.time) / _PERIOD)):
                self._task.tick()
                if self._task.update_revision() or self._task.ended.is_set():
                    break
        finally:
            self._manager.ticked = None
        return self._compared(told)

    def nodes_at(self, told: Told) -> Callable[[Any], tuple[Seen | None, Seen | None]]:
        """What tells, of the node that an instance of a skill belongs to, how it was told of before and how then."""
        before, now = ({seen.place: seen for seen in message.nodes} for message in (self.told, told))
        places = {id(getattr(node, "_instance", None)): place for place, node in _places(self._task.root)}

        def nodes(skill: Any) -> tuple[Seen | None, Seen | None]:
            place = places.get(id(skill)) if skill is not None else None
            return (before.get(place), now.get(place)) if place is not None else (None, None)

        return nodes

    def told_of(self, skill: Any) -> Seen | None:
        """What the recording tells, at this tick, of the node that an instance of a skill belongs to."""
        for place, node in _places(self._task.root):
            if getattr(node, "_instance", None) is skill:
                return next((seen for seen in self.told.nodes if seen.place == place), None)
        return None

    def take_due(self) -> list[Change]:
        """The changes that are due and were not made yet."""
        due, self._due = self._due, []
        return due

    def context(self, told: Told) -> tuple[str, ...]:
        """What was told before, a line for each node that had changed."""
        index = self.run.told.index(told)
        lines: list[str] = []
        for number in range(max(1, index - CONTEXT), index):
            before, now = self.run.told[number - 1], self.run.told[number]
            known = {node.place: node for node in before.nodes}
            changed = [node for node in now.nodes if known.get(node.place) != node]
            lines += [f"tick {number + 1}: {path_of(now.nodes, node.place)}: {node_text(node)}" for node in changed]
        return tuple(lines[-2 * CONTEXT :])

    def _compared(self, told: Told) -> tuple[str, str, str] | None:
        got = self._seen()
        place = first_difference(told.nodes, got, self._tolerance)
        if place is None:
            return None
        wanted, found = (next((n for n in nodes if n.place == place), None) for nodes in (told.nodes, got))
        named = wanted is not None and found is not None and wanted.name != found.name
        texts = [f"{n.name}: {node_text(n)}" if n is not None and named else node_text(n) for n in (wanted, found)]
        return path_of(told.nodes if wanted is not None else got, place), texts[0], texts[1]

    def _seen(self) -> list[Seen]:
        places = {id(node): place for place, node in _places(self._task.root)}
        by_id = {node._id: places[id(node)] for _, node in _places(self._task.root)}
        progress = self._task.progress()
        by_id.update({node._id: places[id(node)] for _, node in _places(self._task.root)})
        return [
            Seen(
                by_id[node.id], wire_text(node.type), wire_text(node.label), node.processor,
                _LETTERS.get(node.state, "."), wire_code(node.progress_code), wire_text(node.progress_message),
                node.progress_time,
            )
            for node in progress
        ]  # fmt: skip


def _requests(run: TaskRun) -> list[SkillRequest]:
    """What was asked for.

    :raises BagError: the bag does not tell.
    """
    if run.skills:
        return [SkillRequest(s.type, s.name, utils.deserializeParamMap(s.params)) for s in run.skills]
    roots = [node for node in run.told[0].nodes if len(node.place) == 1]
    if not any(node.params for node in roots):
        raise BagError(
            f"{run}: the bag has neither the goal that has asked for it nor its parameters; expected a goal on "
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
    """As a `Param` message."""

    def __init__(self, param: str) -> None:
        self.param = param


def _places(root: Any) -> list[tuple[tuple[int, ...], Any]]:
    """The nodes of a tree with their places, each before its children."""
    found = []
    waiting: list[tuple[tuple[int, ...], Any]] = [((), root)]
    while waiting:
        place, node = waiting.pop()
        found.append((place, node))
        waiting += [((*place, index), child) for index, child in enumerate(node.children)][::-1]
    return found
