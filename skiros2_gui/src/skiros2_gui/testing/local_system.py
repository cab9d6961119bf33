"""A system in this process, without ROS: the world model and robots with skills."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.params import ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import ParamsEncoder, decodeParam
from skiros2_gui.app.event_queue import EventQueue
from skiros2_gui.app.events import ConnectionChanged, ManagersChanged, TaskProgress, WorldChanged
from skiros2_gui.app.system import MANAGER, WORLD_MODEL, Manager, Part, Planner
from skiros2_skill.command_line.description import Skill, read_skill
from skiros2_skill.core.diagnosis.inspection import NodeStatus, inspect
from skiros2_skill.core.engine.breakpoints import Breakpoint
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.history import REFUSED, History, Record
from skiros2_skill.core.runtime.request import SkillRequest, explain_refusal, make_nodes
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.registration import Registration
from skiros2_world_model.core.changes import RESET, Change
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.ontology import Ontology
from skiros2_world_model.core.reader import SceneReader

_STATES = {State.Success: 1, State.Failure: 2, State.Running: 3}
_IDLE = 4

_ALL = -1


@dataclass
class Node:
    """A node of a task, with the fields of `SkillProgress`."""

    robot: str
    task_id: int
    id: int
    parent_label: str
    parent_id: int
    type: str
    label: str
    params: list[Any]
    processor: str
    state: int
    progress_code: int
    progress_period: float
    progress_time: float
    progress_message: str


@dataclass
class Why:
    """The response of `Manager.why`."""

    ok: bool
    text: str
    json: str


class LocalManager:
    """A skill manager with a ticker thread; `close` ends it.

    :param name: the node name, with its slash.
    :param skills: classes of implementations.
    :param on_progress: called with each progress, in the ticker thread.
    :param robot: the label of the robot, which is in the scene.
    """

    def __init__(
        self,
        wm: LocalWorldModel,
        name: str,
        skills: Sequence[type],
        on_progress: Callable[[TaskProgress], None],
        robot: str,
    ) -> None:
        self._name = name
        self._wm = wm
        self._report = on_progress
        self._library = SkillLibrary(wm)
        for skill in skills:
            self._library.add(skill)
        prefix, _, local = robot.rpartition(":")
        self._registration = Registration(wm, prefix, local, name)
        self._registration.register(self._library.implementations())
        self._history = History()
        self._scheduler = Scheduler(on_progress=self._on_progress)
        wm.add_listener(self._scheduler.on_change)

    @property
    def name(self) -> str:
        return self._name

    def close(self) -> None:
        """Ends its tasks and its thread."""
        self._wm.remove_listener(self._scheduler.on_change)
        self._scheduler.stop()

    def skills(self) -> list[Skill]:
        return [
            read_skill(
                i.type,
                i.label,
                [json.dumps(p, cls=ParamsEncoder) for p in i.declared.params.getParamMap().values()],
            )
            for i in self._library.implementations()
        ]

    def command(self, action: str, task_id: int, skills: Sequence[Any] = ()) -> int:
        ticks = 1 if action == "tick_once" else 0
        if action in ("start", "tick_once"):
            number = self._make(skills) if task_id == _ALL else task_id
            self._scheduler.start(number, ticks)
            return number
        if action not in ("preempt", "pause"):
            raise UnknownName(f"unknown action {action!r}, expected one of: start, preempt, pause, tick_once")
        for number in [t.id for t in self._scheduler.tasks()] if task_id == _ALL else [task_id]:
            (self._scheduler.preempt if action == "preempt" else self._scheduler.pause)(number)
        return task_id

    def tasks(self, task_id: int = _ALL) -> list[Sequence[Any]]:
        return [self._nodes(task) for task in self._scheduler.tasks() if task_id in (_ALL, task.id)]

    def why(self, task_id: int) -> Any:
        record = self._history.get(task_id)
        return Why(True, str(record), json.dumps([e.to_dict() for e in record.explanations]))

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        return inspect(self._scheduler.get(task_id), node_id, self._wm)

    def breakpoint(self, action: str, kind: str = "", pattern: str = "", when: str = "", number: int = 0) -> Any:
        known = self._scheduler.breakpoints
        if action == "add":
            number = known.add(Breakpoint(kind, pattern, when))
        elif action == "remove":
            for one in list(known.all()) if number == _ALL else [number]:
                known.remove(one)
        listed = [{"number": n, "kind": b.kind, "pattern": b.pattern, "when": b.when} for n, b in known.all().items()]
        return number, listed

    def _make(self, skills: Sequence[Any]) -> int:
        requests = [
            SkillRequest(s.type, s.label, {p.key: p for p in (decodeParam(text) for text in s.params)}) for s in skills
        ]
        try:
            nodes = make_nodes(requests, self._library, self._wm)
        except Exception as error:
            explanation = explain_refusal(requests, self._library, self._wm, -1)
            explanations = [explanation] if explanation is not None else []
            self._history.refuse(Record(REFUSED, "window", State.Idle, -1, str(error), explanations))
            raise Refused(f"start by window refused: {error}") from error
        task = self._scheduler.new_task(self._wm, "window")
        task.root.params.addParam("Robot", self._registration.robot, ParamTypes.Inferred)
        task.root(*nodes)
        self._history.begin(task)
        return task.id

    def _on_progress(self, task: Task) -> None:
        if task.ended.is_set():
            self._history.end(task)
        self._report(TaskProgress(self._name, self._nodes(task), time.time()))

    def _nodes(self, task: Task) -> list[Node]:
        return [
            Node(
                self._name, task.id, n.id, n.parent_label, n.parent_id, n.type, n.label, [], n.processor,
                _STATES.get(n.state, _IDLE), n.progress_code, n.progress_period, n.progress_time, n.progress_message,
            )
            for n in task.progress()
        ]  # fmt: skip


class LocalSystem:
    """Implements `app.system.System` with a world model of this process.

    :param wm: its author is the author of the window's changes.
    """

    def __init__(self, event_queue: EventQueue, wm: LocalWorldModel | None = None) -> None:
        self._event_queue = event_queue
        self._wm = wm if wm is not None else LocalWorldModel("window")
        self._is_up = True
        self._since = time.time()
        self._managers: dict[str, LocalManager] = {}
        self.planner: Planner | None = None
        #: The argument of the last `set_movable`.
        self.movable = ""
        self._wm.add_listener(self._on_change)

    @property
    def parts(self) -> list[Part]:
        managers = [Part(MANAGER, name, True, self._since) for name in self._managers]
        return [Part(WORLD_MODEL, "wm", self._is_up, self._since), *managers]

    @property
    def world(self) -> LocalWorldModel:
        return self._wm

    @property
    def scene(self) -> SceneReader:
        return self._wm.model.reader

    @property
    def ontology(self) -> Ontology:
        return self._wm.model.ontology

    @property
    def managers(self) -> dict[str, Manager]:
        return dict(self._managers)

    def add_manager(self, name: str, skills: Sequence[type], robot: str = "skiros:test_robot") -> LocalManager:
        """Adds a manager, and its robot if it is not in the scene.

        :param name: the node name, with its slash.
        :param robot: the robot's label.
        """
        if not any(e.label == robot for e in self._robots()):
            element = Element("cora:Robot", robot)
            element.addRelation("skiros:Scene-0", "skiros:contain", "-1")
            self._wm.add_element(element)
        manager = LocalManager(self._wm, name, skills, self._event_queue.put, robot)
        self._managers[name] = manager
        self._event_queue.put(ManagersChanged())
        return manager

    def remove_manager(self, name: str) -> None:
        """Removes a manager."""
        self._managers.pop(name).close()
        self._event_queue.put(ManagersChanged())

    def set_up(self, is_up: bool) -> None:
        """Sets the status of the world model."""
        self._is_up, self._since = is_up, time.time()
        self._event_queue.put(ConnectionChanged())

    def set_movable(self, eid: str) -> None:
        self.movable = eid

    def close(self) -> None:
        self._wm.remove_listener(self._on_change)
        for manager in self._managers.values():
            manager.close()
        self._managers.clear()

    def _robots(self) -> list[Any]:
        return self._wm.resolve_elements(Element("cora:Robot"))

    def _on_change(self, change: Change) -> None:
        is_other = change.action == RESET
        of_ontology = is_other or not (change.elements or change.relations)
        self._event_queue.put(WorldChanged((change,), is_other, of_ontology))
