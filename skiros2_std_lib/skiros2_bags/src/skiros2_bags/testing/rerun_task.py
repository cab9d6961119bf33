"""A recorded task that is ticked again, and its manager, which loads the skills that the recorded world model lists."""

from __future__ import annotations

import copy
import importlib.util
import inspect
import logging
import math
from collections.abc import Callable, Collection, Iterator
from typing import Any

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.testing.declared import Declared
from skiros2_bags.testing.evidence import RecordedEvidence
from skiros2_bags.testing.fake_action_clients import RecordedActions, StatesOf
from skiros2_bags.testing.field_tolerances import FieldTolerances
from skiros2_bags.testing.recorded_world import change_operations
from skiros2_bags.testing.recording import RecordedTask, TaskProgress
from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import ConfigurationError, Refused, SkirosError
from skiros2_common.core.manager_names import runs_on
from skiros2_common.core.operations import Change
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.signals import LocalSignals
from skiros2_common.core.world_element import Element
from skiros2_common.core.write_notes import noting_writes
from skiros2_common.ros import utils
from skiros2_runs.core.compare import CONTEXT, first_difference, path_text, report_text
from skiros2_runs.core.frame import NodeProgress
from skiros2_runs.core.states import FAILURE, RUNNING, SUCCESS, TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_skill.core.engine.hooks import PREEMPTED
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.request import SkillRequest, make_nodes
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_skill.ros.messages import progress_messages
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.world_model import WorldModel

log = logging.getLogger(__name__)


class RerunManager:
    """The skills of one robot.

    :param name: of the manager's node.
    :param replaced_labels: labels of primitives that are replaced by their recorded progress.
    :param declared: what its skills have declared.
    :param libraries: packages whose skills it could use, besides those of its registered skills.
    """

    def __init__(
        self,
        name: str,
        model: WorldModel,
        actions: RecordedActions,
        replaced_labels: frozenset[str],
        declared: Declared,
        libraries: Collection[str] = (),
    ) -> None:
        self.name = name
        self.wmi = LocalWorldModel(name, model)
        self.library = SkillLibrary(self.wmi)
        self.actions = actions
        self.signals = LocalSignals()
        #: The task that is currently ticked.
        self.ticked: Any = None
        #: When a played primitive was ticked last, and when one has ended last (s, recording time).
        self.played_at = self.played_ended_at = -math.inf
        self._replaced_labels = replaced_labels
        self._declared = declared
        self._libraries = libraries

    @property
    def is_ticking(self) -> bool:
        return self.ticked is not None

    @property
    def robot(self) -> Element:
        """The current element of the robot.

        :raises BagError: the scene has no robot of this manager.
        """
        for robot in self.wmi.resolve_elements(Element("cora:Robot")):
            if runs_on(robot, self.name):
                found: Element = robot
                return found
        raise BagError(f"the recorded scene has no robot of the skill manager {self.name}")

    def load(self) -> None:
        """Loads the registered skills.

        :raises ConfigurationError: a skill does not exist.
        """
        listed = []
        for relation in self.wmi.get_relations(self.robot.id, "skiros:hasSkill", ""):
            skill = self.wmi.get_element(relation["dst"])
            listed.append((skill.getIdNumber(), str(skill.value_of("skiros:PythonModule")), skill.label))
        if not listed:
            raise BagError(f"the recorded scene lists no skills of {self.name}")
        known = {name for name in self._libraries if importlib.util.find_spec(name.partition(".")[0]) is not None}
        self.library.import_libraries(sorted(known | {module.partition(".")[0] for _, module, _ in listed}))
        for _, module, label in sorted(listed):
            cls = _implementation(module, label)
            self.library.add(replay_primitive(cls, self) if is_replaced(cls, label, self._replaced_labels) else cls)

    def declared_differently(self, used: Collection[str]) -> list[str]:
        """Returns how what skills declare differs from the recording, a line each.

        :param used: the labels of the skills that the recorded tasks use.
        """
        return self._declared.differences(self.library.implementations(), used)

    def is_played(self, label: str) -> bool:
        """Whether a skill is replaced by its recorded progress."""
        found = (i for i in self.library.implementations() if i.label == label)
        return any(is_replaced(i.cls, i.label, self._replaced_labels) for i in found)

    def not_compared(self, used: Collection[str]) -> list[str]:
        """Returns what a re-run does not compare, a line each."""
        played = [i.label for i in self.library.implementations() if self.is_played(i.label)]
        lines = [f"what {label} does: its recorded progress is played" for label in played if label in used]
        return self._declared.not_compared + lines


def _implementation(module: str, label: str) -> type:
    """Returns the class in a module that implements a skill with a label.

    :raises ConfigurationError: there is none.
    """
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        raise ConfigurationError(f"skill {label}: module {module} cannot be imported: {error}") from error
    classes = list(_skills(found))
    for cls in sorted(classes, key=lambda c: c.__name__ != label):
        if cls.__name__ == label or _label_of(cls) == label:
            return cls
    names = ", ".join(c.__name__ for c in classes) or "none"
    raise ConfigurationError(f"skill {label}: module {module} has no implementation of that label; it has: {names}")


def _skills(module: Any) -> Iterator[type]:
    for _, cls in inspect.getmembers(module, inspect.isclass):
        is_own = cls.__module__ == module.__name__
        if is_own and issubclass(cls, SkillBase | PrimitiveBase) and not inspect.isabstract(cls):
            yield cls


def _label_of(cls: type) -> str:
    try:
        skill = cls()
        skill.createDescription()
    except Exception as error:  # library code; then the class is not the wanted one
        log.debug("%s: %s", cls, error)
        return ""
    return str(getattr(skill, "_label", ""))


_STATES: dict[int, State] = {RUNNING: State.Running, SUCCESS: State.Success, FAILURE: State.Failure}


def is_replaced(cls: type, label: str, labels: frozenset[str]) -> bool:
    """Whether a primitive is replaced by its recorded progress: by its label, or as its class says."""
    return issubclass(cls, PrimitiveBase) and (label in labels or cls.replays_progress)


def replay_primitive(cls: type, manager: Any) -> type:
    """Returns a subclass of a primitive with the same description, whose hooks report the recorded progress.

    :param manager: the `RerunManager`.
    """

    def recorded_node(skill: Any) -> NodeProgress | None:
        recorded: NodeProgress | None = manager.ticked.recorded_node(skill) if manager.ticked is not None else None
        return recorded

    def push(self: Any) -> bool:
        if manager.ticked is not None:
            manager.ticked.set_pushed_values(self)
        return True

    def execute(self: Any) -> State:
        recorded = recorded_node(self)
        if recorded is None or recorded.state not in _STATES:
            return self.step()  # type: ignore[no-any-return]
        if recorded.code == PREEMPTED and manager.ticked.is_preempting:
            return State.Running
        manager.played_at = manager.ticked.progress.time
        if recorded.state != RUNNING:
            manager.played_ended_at = manager.played_at
            with noting_writes(None):
                for change in manager.ticked.take_due_changes():
                    manager.wmi.transact(change_operations(change, manager.wmi.model.scene()))
        self._setProgress(recorded.message, recorded.code)
        return _STATES[recorded.state]

    def on_preempt(self: Any) -> State:
        recorded = recorded_node(self)
        if recorded is not None:
            self._setProgress(recorded.message, recorded.code)
        return State.Failure

    hooks = {"onInit": lambda self: True, "onStart": push, "execute": execute, "onPreempt": on_preempt, "onEnd": push}
    return type(cls.__name__, (cls,), {**hooks, "__module__": cls.__module__, "__abstractmethods__": frozenset()})


#: Period of a manager's ticks (s); most ticks publish no progress.
_PERIOD = 0.04


class RerunTask:
    """A task, created like the manager created it.

    :param manager: the `RerunManager`.
    :raises BagError: the bag does not contain the request.
    """

    def __init__(self, run: RecordedTask, manager: Any, tolerances: FieldTolerances) -> None:
        self.run = run
        self._manager = manager
        self._tolerances = tolerances
        #: The last recorded progress.
        self.progress: TaskProgress = run.progress[0]
        #: Whether the tree preempts the primitives that have failed with `PREEMPTED` in the current tick.
        self.is_preempting = False
        self._due_changes: Callable[[], list[Change]] = list
        self._rejection = ""
        try:
            nodes = make_nodes(_requests(run), manager.library, manager.wmi)
        except Refused as error:
            nodes, self._rejection = [], str(error)
        goal = run.goal.content.goal if run.goal is not None else ""
        self._task = Task(run.run.task_id, manager.wmi, run.manager, signals=manager.signals, goal=goal)
        self._task.root.params.addParam("Robot", manager.robot, ParamTypes.Inferred, "The manager's robot")
        self._task.root(*nodes)
        self._task.evidence.is_on = run.evidence is not None
        self._task.evidence.has_writes = run.has_writes
        played = pushed_by(run, manager.is_played) if run.evidence else frozenset()
        paths = _paths(run, manager.is_played)
        entries = [e for e in run.evidence or () if e[1] != "write" or e[0] not in paths]
        self._evidence = RecordedEvidence(entries, tolerances, played)

    def preempt(self) -> None:
        """Requests preemption of the task."""
        self._task.preempt()

    def set_readings(self, progress: TaskProgress, origin: float) -> None:
        """Sets the times that the skills read in the next tick, as far as they were recorded.

        :param origin: the recorded time (s) at which the clock of the re-run is 0.
        """
        found: dict[str, list[float]] = {}
        for path, time in self.run.readings.get(progress.number, ()):
            found.setdefault(path, []).append(time - origin)
        self._task.evidence.recorded_readings = found

    def tick(
        self, progress: TaskProgress, due_changes: Callable[[], list[Change]], is_preempting: bool
    ) -> tuple[str, str, str] | None:
        """Ticks until there is progress to publish, at most as often as the manager can have ticked.

        :param due_changes: lists the recorded changes that this tick may still make.
        :param is_preempting: see `Ordering.preempting`.
        :returns: a mismatch (node, recorded, now); None without one.
        """
        if self._rejection:
            return "the task is refused", "it runs", self._rejection
        before, self.progress, self._due_changes = self.progress, progress, due_changes
        self.is_preempting = is_preempting
        state = progress.frame.task_state
        if state is TaskState.PAUSED:
            return None
        if state in (TaskState.ENDING, TaskState.PREEMPTED) and self._task.preempted_at is None:
            self._task.preempt()  # requested by a command, which bags do not contain
        self._manager.ticked = self
        try:
            for _ in range(2 + int((progress.time - before.time) / _PERIOD)):
                self._task.tick()
                if self._task.update_revision() or self._task.ended.is_set():
                    break
        finally:
            self._manager.ticked = None
        return self._diff(progress) or self._evidence_difference(progress)

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

    def set_pushed_values(self, skill: Any) -> None:
        """Sets the parameters of a played skill that the recorded one has pushed at this point."""
        evidence = self._task.evidence
        if not evidence.is_on:
            return
        for path, node in _index_paths(self._task.root):
            if getattr(node, "instance", None) is skill:
                slots = {slot.key: slot for slot in node.run.slots}
                for key, values in self._evidence.pushes(evidence.waiting, path):
                    if key in slots:
                        slots[key].param.values = self._values(slots[key].is_element, values or [])

    def _values(self, are_elements: bool, values: list[Any]) -> list[Any]:
        if not are_elements:
            return copy.deepcopy(values)  # a skill may change them in place
        found = [self._manager.wmi.find_element(eid) for eid in values]
        return [element for element in found if element is not None]

    def take_due_changes(self) -> list[Change]:
        """Returns the due changes that were not made yet, once in a tick."""
        due_changes, self._due_changes = self._due_changes, list
        return due_changes()

    def context(self, progress: TaskProgress) -> tuple[str, ...]:
        """Returns the recorded state changes before a progress message, one line each."""
        index = self.run.progress.index(progress)
        lines: list[str] = []
        for number in range(max(1, index - CONTEXT), index):
            before, now = self.run.progress[number - 1].frame.nodes, self.run.progress[number].frame.nodes
            changed = [n for path, n in now.items() if path not in before or _report(before[path]) != _report(n)]
            lines += [f"tick {number + 1}: {path_text(n.path)}: {report_text(*_report(n))}" for n in changed]
        return tuple(lines[-2 * CONTEXT :])

    def _evidence_difference(self, progress: TaskProgress) -> tuple[str, str, str] | None:
        if not self._task.evidence.is_on:
            return None
        made = self._task.evidence.take()
        return self._evidence.difference(made, progress.frame.nodes, is_end=self._task.ended.is_set())

    def _diff(self, progress: TaskProgress) -> tuple[str, str, str] | None:
        now = TaskRun(self.run.manager, self.run.run.task_id)
        now.record(progress_messages(self._task, self.run.manager), progress.time)
        wanted, found = progress.frame.nodes, now.latest.nodes
        path = first_difference(wanted, found, self._tolerances.of_message)
        if path is None:
            return None
        nodes = [tree.get(path) for tree in (wanted, found)]
        there = [node for node in nodes if node is not None]
        has_other_name = len({node.name for node in there}) > 1
        has_other_processor = len({node.processor for node in there}) > 1
        texts = [
            "no such node" if node is None else _node_text(node, has_other_name, has_other_processor) for node in nodes
        ]
        return path_text(there[0].path), texts[0], texts[1]


def pushed_by(run: RecordedTask, has_label: Callable[[str], bool]) -> frozenset[str]:
    """Returns the keys that nodes of a recorded task with some labels have pushed at their ends."""
    paths = _paths(run, has_label)
    found, last_hooks = set(), dict[str, str]()
    for path, kind, name, _ in run.evidence or ():
        if kind == "hook":
            last_hooks[path] = name
        elif kind == "push" and last_hooks.get(path) == "onEnd" and path in paths:
            found.add(name)
    return frozenset(found)


def written_by(run: RecordedTask, has_label: Callable[[str], bool]) -> frozenset[str]:
    """Returns what nodes of a recorded task with some labels have requested of the world model."""
    paths = _paths(run, has_label)
    texts = (name for path, kind, name, _ in run.evidence or () if kind == "write" and path in paths)
    return frozenset(each for text in texts for each in text.split(", "))


def _paths(run: RecordedTask, has_label: Callable[[str], bool]) -> set[str]:
    """Returns the paths of the nodes of a recorded task with some labels, as in its evidence."""
    shapes = {id(each.frame.shape): each.frame.shape for each in run.progress}.values()
    labels = {(shape.label(i), path) for shape in shapes for i, path in enumerate(shape.index_paths)}
    chosen = {label for label in {label for label, _ in labels} if has_label(label)}
    return {".".join(map(str, path)) for label, path in labels if label in chosen}


def _node_text(node: NodeProgress, with_name: bool, with_processor: bool) -> str:
    text = report_text(*_report(node))
    text = f"processor {node.processor or 'none'}, {text}" if with_processor else text
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
