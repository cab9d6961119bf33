"""The client of one skill manager."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from std_msgs.msg import Bool, Empty

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.names import nearest
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs
from skiros2_msgs import srv as srvs
from skiros2_skill.core.diagnosis.inspection import NodeStatus
from skiros2_skill.core.engine.breakpoints import Breakpoint
from skiros2_skill.ros.skill_run import SkillRun, SkillRunner
from skiros2_skill.ros.utils import SkillHolder
from skiros2_world_model.ros.service_pool import ServicePool

log = logging.getLogger(__name__)


class SkillManagerInterface:
    """Starts, stops and monitors tasks of a manager. Any thread.

    :param manager_name: the manager's node name.
    :param author_name: named in the manager's log.
    """

    def __init__(self, manager_name: str, author_name: str) -> None:
        self._name = manager_name
        self._author = author_name
        self._lock = threading.RLock()
        self._skills: dict[str, SkillHolder] = {}
        self._tasks: dict[int, Any] = {}
        self._ended: set[int] = set()  # tasks that have ended since the last command was sent
        self._started = -1
        self._monitor_cb: Callable[[Any], None] | None = None
        self._tick_times: list[float] = []
        self.last_error = ""
        self._get_skills = ServicePool(f"{manager_name}/get_skills", srvs.ResourceGetDescriptions, 0.0)
        self._command = ServicePool(f"{manager_name}/command", srvs.SkillCommand, 0.0)
        self._why = ServicePool(f"{manager_name}/why", srvs.SkillWhy, 0.0)
        self._inspect = ServicePool(f"{manager_name}/inspect", srvs.SkillInspection, 0.0)
        self._breakpoint = ServicePool(f"{manager_name}/breakpoint", srvs.SkillBreakpoint, 0.0)
        self._runner: SkillRunner | None = None
        self._debug_pub = rospy.Publisher(f"{manager_name}/set_debug", Bool, queue_size=1, latch=True)
        self._monitor_sub = rospy.Subscriber(
            f"{manager_name}/monitor", msgs.TreeProgress, self._on_progress, queue_size=1000
        )
        self._tick_sub = rospy.Subscriber(f"{manager_name}/tick_rate", Empty, self._on_tick)

    @property
    def name(self) -> str:
        """The manager's node name."""
        return self._name

    @property
    def task(self) -> int:
        """The id of the manager's first task that has not ended; -1 for none."""
        return next(iter(self.tasks), -1)

    @property
    def tasks(self) -> list[int]:
        """The ids of the manager's tasks that have not ended, the first reported ones first."""
        with self._lock:
            return list(self._tasks)

    @property
    def progress(self) -> dict[int, Any]:
        """The last `TreeProgress` of each task that has not ended, by its id."""
        with self._lock:
            return {task_id: message for task_id, message in self._tasks.items() if message is not None}

    @property
    def skills(self) -> dict[str, SkillHolder]:
        """The skills that the manager offers, by label."""
        return self.get_skill_list()

    @property
    def _skill_list(self) -> dict[str, SkillHolder]:
        """Same as `skills`; other programs' windows read it."""
        return self.get_skill_list()

    def shutdown(self) -> None:
        """Closes all connections."""
        for connection in (self._monitor_sub, self._tick_sub, self._debug_pub):
            connection.unregister()
        for service in (self._get_skills, self._command, self._why, self._inspect, self._breakpoint):
            service.close()
        with self._lock:
            runner, self._runner = self._runner, None
        if runner is not None:
            runner.close()

    def print_state(self) -> str:
        """The manager and its skills, one per line."""
        return "\n".join([f"{self._name}:", *(f"  {s.type}-{s.name}" for s in self.skills.values())])

    def set_debug(self, state: bool) -> None:
        """Sets whether progress messages include the parameters."""
        self._debug_pub.publish(state)

    # -- skills ------------------------------------------------------------------------------------------------

    def get_skill_list(self, update: bool = False) -> dict[str, SkillHolder]:
        """The skills that the manager offers, by label. Waits until it has loaded them.

        :param update: ask the manager even if the list is known.
        """
        if update or not self._skills:
            answer = self.call(self._get_skills.call, srvs.ResourceGetDescriptionsRequest())
            if answer is not None:
                with self._lock:
                    self._skills = {
                        s.name: SkillHolder(self._name, s.type, s.name, utils.deserializeParamMap(s.params))
                        for s in answer.list
                    }
        return self._skills

    def get_skill(self, name: str) -> SkillHolder:
        """A skill by label, with parameters that can be set.

        :raises UnknownName: the manager has no such skill.
        """
        found = self.get_skill_list().get(name) or self.get_skill_list(update=True).get(name)
        if found is None:
            near = nearest(name, self._skills) or list(self._skills)
            raise UnknownName(f"{self._name} has no skill {name!r}; near: {', '.join(near) or 'none'}")
        params = {key: param.clone() for key, param in found.ph.items()}
        return SkillHolder(found.manager, found.type, found.name, params)

    # -- commands ----------------------------------------------------------------------------------------------

    def execute(
        self,
        execution_id: int = -1,
        skill_list: Sequence[SkillHolder] | None = None,
        action: str = srvs.SkillCommandRequest().START,
    ) -> int:
        """Sends a command. Returns the task id; -1 when the manager refuses, with the reason in `last_error`.

        :param execution_id: the task; -1 with `start` creates a task that runs the skills in sequence.
        :param skill_list: the skills of a new task.
        """
        request = srvs.SkillCommandRequest(
            author=self._author,
            action=action,
            execution_id=execution_id,
            skills=[skill.toMsg() for skill in skill_list or ()],
        )
        with self._lock:
            self._ended.clear()
        answer = self.call(lambda r: self._command.call(r, repeatable=False), request)
        if answer is None or not answer.ok:
            return -1
        task_id = int(answer.execution_id)
        if action in (request.START, request.TICK_ONCE):
            with self._lock:
                self._started = task_id
                if task_id not in self._ended:
                    self._tasks.setdefault(task_id, None)
        return task_id

    def tick_once(self, execution_id: int = -1, skill_list: Sequence[SkillHolder] | None = None) -> int:
        """Ticks a task once and pauses it; with skills, a new task."""
        return self.execute(execution_id, skill_list, srvs.SkillCommandRequest.TICK_ONCE)

    def preempt_one(self, execution_id: int | None = None) -> bool:
        """Preempts a task, by default the last one started by this client, else the first running one.

        :returns: False when there is no task or the manager refuses; `last_error` has the reason.
        """
        return self._to_one(execution_id, srvs.SkillCommandRequest.PREEMPT)

    def preempt_all(self) -> bool:
        """Preempts all tasks. Returns False when the manager refuses."""
        return self._send(-1, srvs.SkillCommandRequest.PREEMPT)

    def pause_one(self, execution_id: int | None = None) -> bool:
        """Pauses a task; arguments and result as in `preempt_one`."""
        return self._to_one(execution_id, srvs.SkillCommandRequest.PAUSE)

    def pause_all(self) -> bool:
        """Pauses all tasks. Returns False when the manager refuses."""
        return self._send(-1, srvs.SkillCommandRequest.PAUSE)

    def _to_one(self, execution_id: int | None, action: str) -> bool:
        if execution_id is None:
            tasks = self.tasks
            execution_id = self._started if self._started in tasks else next(iter(tasks), -1)
        if execution_id < 0:
            self.last_error = f"{action}: no task of {self._name} is known"
            log.error("%s", self.last_error)
            return False
        return self._send(execution_id, action)

    def _send(self, execution_id: int, action: str) -> bool:
        request = srvs.SkillCommandRequest(author=self._author, action=action, execution_id=execution_id)
        answer = self.call(lambda r: self._command.call(r, repeatable=False), request)
        return answer is not None and bool(answer.ok)

    def call(self, service: Any, msg: Any) -> Any:
        """Calls a service of the manager. Returns None when it does not answer or refuses; the reason is logged."""
        try:
            return service(msg)
        except (rospy.ServiceException, SkirosError) as error:
            self.last_error = str(error)
            log.error("%s: %s", self._name, error)
            return None

    # -- running, and why it failed ----------------------------------------------------------------------------

    def run(self, skill_list: Sequence[SkillHolder], monitor_cb: Callable[[Any], None] | None = None) -> SkillRun:
        """Runs skills in sequence as a new task. Returns a handle to wait for or cancel it.

        :param monitor_cb: called, in a thread of ROS, with each `ExecuteSkillsFeedback`.
        :raises TimedOut: the manager does not answer within 5 s.
        """
        with self._lock:
            if self._runner is None:
                self._runner = SkillRunner(self._name)
            runner = self._runner
        return runner.run(self._author, [skill.toMsg() for skill in skill_list], monitor_cb)

    def why(self, task_id: int = -1) -> str:
        """Why a task or its nodes failed, for people, on several lines.

        :param task_id: -1: the last task that failed or was refused.
        :raises SkirosError: the manager knows no such task, or does not answer.
        """
        return str(self._call_why(task_id).text)

    def explanations(self, task_id: int = -1) -> list[Explanation]:
        """Same as `why`, as data: one explanation per failure, the last one at the end."""
        return [Explanation.from_dict(data) for data in json.loads(self._call_why(task_id).json)]

    def _call_why(self, task_id: int) -> Any:
        answer = self._why.call(srvs.SkillWhyRequest(task_id))
        if not answer.ok:
            raise UnknownName(f"{self._name}: {answer.text}")
        return answer

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        """Inspects a node of a task that has not ended: its parameters, and whether its conditions hold.

        :param node_id: from `SkillProgress`.
        :raises SkirosError: the manager knows no such task or node, or does not answer.
        """
        answer = self._inspect.call(srvs.SkillInspectionRequest(task_id, node_id))
        if not answer.ok:
            raise UnknownName(f"{self._name}: {answer.text}")
        return NodeStatus.from_json(answer.json)

    def set_breakpoint(self, kind: str, pattern: str, when: str = "") -> int:
        """Adds a breakpoint; see `skiros2_skill.core.engine.breakpoints.Breakpoint`. Returns its number.

        :raises SkirosError: the manager refuses, or does not answer.
        """
        request = srvs.SkillBreakpointRequest(srvs.SkillBreakpointRequest.ADD, kind, pattern, when, 0)
        return int(self._breakpoint.call(request, repeatable=False).number)

    def remove_breakpoint(self, number: int = -1) -> None:
        """Removes a breakpoint.

        :param number: -1: all.
        :raises SkirosError: the manager refuses, or does not answer.
        """
        request = srvs.SkillBreakpointRequest(srvs.SkillBreakpointRequest.REMOVE, "", "", "", number)
        self._breakpoint.call(request, repeatable=False)

    def breakpoints(self) -> dict[int, Breakpoint]:
        """The breakpoints by number.

        :raises SkirosError: the manager does not answer.
        """
        answer = self._breakpoint.call(srvs.SkillBreakpointRequest(action=srvs.SkillBreakpointRequest.LIST))
        return {b["number"]: Breakpoint(b["kind"], b["pattern"], b["when"]) for b in json.loads(answer.json)}

    # -- monitoring --------------------------------------------------------------------------------------------

    def set_monitor_cb(self, cb: Callable[[Any], None] | None) -> None:
        """Sets the callback for each `TreeProgress` of the manager; it is called in a thread of ROS."""
        self._monitor_cb = cb

    def get_tick_rate(self) -> float:
        """Ticks per second since the last reset, averaged over at most the last 100; 0.0 when there were none."""
        with self._lock:
            times = self._tick_times[-100:]
        return (len(times) - 1) / (times[-1] - times[0]) if len(times) > 1 else 0.0

    def reset_tick_rate(self) -> None:
        with self._lock:
            self._tick_times = []

    def _on_tick(self, _: Any) -> None:
        with self._lock:
            self._tick_times = [*self._tick_times[-99:], time.monotonic()]

    def _on_progress(self, message: Any) -> None:
        root = message.progress[0] if message.progress else None
        if root is not None:
            with self._lock:
                if abs(root.progress_code) == 1:
                    self._tasks.pop(root.id, None)
                    self._ended.add(root.id)
                else:
                    self._tasks[root.id] = message
        if self._monitor_cb is not None:
            self._monitor_cb(message)
