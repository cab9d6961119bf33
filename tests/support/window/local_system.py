"""A system in this process, without ROS: the world model and robots with skills."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.operations import RESET, Change
from skiros2_common.core.signals import LocalSignals, SignalSource
from skiros2_common.core.world_element import Element
from skiros2_common.ros.utils import ParamsEncoder, decodeParam
from skiros2_gui.app.events import EventQueue, WorldChanged
from skiros2_gui.app.system import Manager, Planner, Simulator
from skiros2_live.core.patch import WORLD_MODEL, Connection, ManagerConnection, SafetyChanged, TaskProgress
from skiros2_runs.core.values import NodeStatus, TaskBounds
from skiros2_skill.client.description import Skill, Step, Why, read_skill
from skiros2_skill.core.breakpoint import Breakpoint
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.diagnosis import inspect, signal_bounds
from skiros2_skill.core.runtime.history import History
from skiros2_skill.core.runtime.request import SkillRequest, TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.start_preview import StartPreview
from skiros2_skill.ros.messages import progress_messages
from skiros2_skill.ros.registration import Registration
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.queries import SceneReader

_ALL = -1


class LocalManager:
    """A skill manager with a ticker thread; `close` ends it.

    :param name: the node name, with its slash.
    :param skills: classes of implementations.
    :param on_progress: called with each progress, in the ticker thread.
    :param robot: the label of the robot, which is in the scene.
    :param signals: for hold-conditions on signals.
    """

    def __init__(
        self,
        wm: LocalWorldModel,
        name: str,
        skills: Sequence[type],
        on_progress: Callable[[TaskProgress], None],
        robot: str,
        signals: SignalSource | None = None,
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
        self._scheduler = Scheduler(on_progress=self._on_progress, signals=signals)
        self._starter = TaskStarter(self._library, wm, self._scheduler, self._history, lambda: self._registration.robot)
        wm.add_listener(self._scheduler.on_change)

    @property
    def name(self) -> str:
        return self._name

    def close(self) -> None:
        """Ends its tasks and its thread."""
        self._wm.remove_listener(self._scheduler.on_change)
        self._scheduler.stop()

    def read_skills(self) -> list[Skill]:
        return [
            read_skill(
                i.type,
                i.label,
                [json.dumps(p, cls=ParamsEncoder) for p in i.declared.params.getParamMap().values()],
            )
            for i in self._library.implementations()
        ]

    def command(self, action: str, task_id: int, skills: Sequence[Step] = ()) -> int:
        ticks = 1 if action == "tick_once" else 0
        if action in ("start", "tick_once"):
            number = self._starter.make("window", [_request(s) for s in skills]).id if task_id == _ALL else task_id
            self._scheduler.start(number, ticks)
            return number
        if action not in ("preempt", "pause"):
            raise UnknownName(f"unknown action {action!r}, expected one of: start, preempt, pause, tick_once")
        for number in [t.id for t in self._scheduler.tasks()] if task_id == _ALL else [task_id]:
            (self._scheduler.preempt if action == "preempt" else self._scheduler.pause)(number)
        return task_id

    def read_tasks(self, task_id: int = _ALL) -> list[Sequence[Any]]:
        return [self._nodes(task) for task in self._scheduler.tasks() if task_id in (_ALL, task.id)]

    def why(self, task_id: int = -1) -> Why:
        record = self._history.get(task_id)
        return Why(str(record), record.explanations)

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        return inspect(self._history.task(task_id), node_id, self._wm)

    def signal_bounds(self, task_id: int) -> TaskBounds:
        return signal_bounds(self._history.task(task_id))

    def set_breakpoint(self, kind: str, pattern: str, when: str = "") -> int:
        return self._scheduler.breakpoints.add(Breakpoint(kind, pattern, when))

    def remove_breakpoint(self, number: int = _ALL) -> None:
        for one in list(self.breakpoints()) if number == _ALL else [number]:
            self._scheduler.breakpoints.remove(one)

    def breakpoints(self) -> dict[int, Breakpoint]:
        return self._scheduler.breakpoints.all()

    def preview(self, skills: Sequence[Step], partial: bool = False) -> StartPreview:
        return self._starter.preview([_request(skill) for skill in skills], partial)

    def _on_progress(self, task: Task) -> None:
        if task.ended.is_set():
            self._history.end(task)
        self._report(TaskProgress(self._name, self._nodes(task), time.time()))

    def _nodes(self, task: Task) -> list[Any]:
        return progress_messages(task, self._name)


def _request(step: Step) -> SkillRequest:
    return SkillRequest(step.type, step.label, {p.key: p for p in map(decodeParam, step.params)})


class LocalSystem:
    """Implements `app.system.System` with a world model of this process.

    :param wm: its author is the author of the window's changes.
    """

    def __init__(self, event_queue: EventQueue, wm: LocalWorldModel | None = None) -> None:
        self._event_queue = event_queue
        self._wm = wm if wm is not None else LocalWorldModel("window")
        self._connection = Connection(WORLD_MODEL, "wm", True, time.time())
        event_queue.put(self._connection)
        self._managers: dict[str, LocalManager] = {}
        self.planner: Planner | None = None
        self.signals = LocalSignals()
        self.simulator: Simulator | None = None
        #: The address of a gateway; "": there is none.
        self.gateway = ""
        #: The argument of the last `set_movable`.
        self.movable = ""
        self._wm.add_listener(self._on_change)

    @property
    def world(self) -> LocalWorldModel:
        return self._wm

    @property
    def scene(self) -> SceneReader:
        return self._wm.model.reader

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
        wm = LocalWorldModel(name, self._wm.model)
        manager = LocalManager(wm, name, skills, self._event_queue.put, robot, self.signals)
        self._managers[name] = manager
        self._event_queue.put(ManagerConnection(name, True))
        return manager

    def remove_manager(self, name: str) -> None:
        """Removes a manager."""
        self._managers.pop(name).close()
        self._event_queue.put(ManagerConnection(name, False))

    def set_up(self, is_up: bool) -> None:
        """Sets the status of the world model."""
        self._connection = self._connection.updated(is_up)
        self._event_queue.put(self._connection)

    def set_stop(self, name: str, state: str, *stops: str, since: float = 0.0) -> None:
        """Sets the safety state of a manager's robot; `running` for none."""
        self._event_queue.put(SafetyChanged(name, state, "", stops, since))

    def set_movable(self, eid: str) -> None:
        self.movable = eid

    def gateway_address(self) -> str:
        return self.gateway

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
