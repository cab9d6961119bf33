"""The client of one skill manager with the names that authors of clients use."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import rospy
from std_msgs.msg import Bool, Empty

from skiros2_common.core.errors import SkirosError, UnknownName
from skiros2_common.core.names import nearest
from skiros2_common.ros import utils
from skiros2_msgs.msg import TreeProgress
from skiros2_msgs.srv import SkillCommandRequest
from skiros2_skill.client.manager import ALL, NEW, ManagerClient
from skiros2_skill.ros.utils import SkillHolder

log = logging.getLogger(__name__)

#: How long a start waits for the connection on which the end of the task is published (s).
_CONNECT_TIMEOUT = 2.0
_POLL_PERIOD = 0.005


class SkillManagerInterface(ManagerClient):
    """Starts, stops and monitors tasks of a manager. Any thread. Needs a node.

    Commands return -1 or False instead of raising errors; `last_error` has the reason.

    :param manager_name: the manager's node name.
    :param author_name: named in the manager's log.
    """

    def __init__(self, manager_name: str, author_name: str) -> None:
        super().__init__(manager_name, author_name)
        self._lock = threading.RLock()
        self._skills: dict[str, SkillHolder] = {}
        self._tasks: dict[int, Any] = {}
        self._ended: set[int] = set()  # tasks that have ended since the last command was sent
        self._started = -1
        self._monitor_cb: Callable[[Any], None] | None = None
        self._tick_times: list[float] = []
        self.last_error = ""
        self._debug_pub = rospy.Publisher(f"{manager_name}/set_debug", Bool, queue_size=1, latch=True)
        self._monitor_sub = rospy.Subscriber(
            f"{manager_name}/monitor", TreeProgress, self._on_progress, queue_size=1000
        )
        self._tick_sub = rospy.Subscriber(f"{manager_name}/tick_rate", Empty, self._on_tick)

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
        self.close()

    def print_state(self) -> str:
        """The manager and its skills, one per line."""
        return "\n".join([f"{self.name}:", *(f"  {s.type}-{s.name}" for s in self.skills.values())])

    def set_debug(self, state: bool) -> None:
        """Sets whether progress messages include the parameters."""
        self._debug_pub.publish(state)

    # -- skills ------------------------------------------------------------------------------------------------

    def get_skill_list(self, update: bool = False) -> dict[str, SkillHolder]:
        """The skills that the manager offers, by label. Waits until it has loaded them.

        :param update: ask the manager even if the list is known.
        """
        if update or not self._skills:
            descriptions = self.call(lambda _: self.descriptions(), None)
            if descriptions is not None:
                with self._lock:
                    self._skills = {
                        s.name: SkillHolder(self.name, s.type, s.name, utils.deserializeParamMap(s.params))
                        for s in descriptions
                    }
        return self._skills

    def get_skill(self, name: str) -> SkillHolder:
        """A skill by label, with parameters that can be set.

        :raises UnknownName: the manager has no such skill.
        """
        found = self.get_skill_list().get(name) or self.get_skill_list(update=True).get(name)
        if found is None:
            near = nearest(name, self._skills) or list(self._skills)
            raise UnknownName(f"{self.name} has no skill {name!r}; near: {', '.join(near) or 'none'}")
        params = {key: param.clone() for key, param in found.ph.items()}
        return SkillHolder(found.manager, found.type, found.name, params)

    # -- commands ----------------------------------------------------------------------------------------------

    def execute(
        self,
        execution_id: int = NEW,
        skill_list: Sequence[SkillHolder] | None = None,
        action: str = SkillCommandRequest().START,
    ) -> int:
        """Sends a command. Returns the task id; -1 when the manager refuses, with the reason in `last_error`.

        :param execution_id: the task; `NEW` with `start` creates a task that runs the skills in sequence.
        :param skill_list: the skills of a new task.
        """
        if action in (SkillCommandRequest.START, SkillCommandRequest.TICK_ONCE):
            self._wait_for_monitor()
        with self._lock:
            self._ended.clear()
        answer: int | None = self.call(lambda skills: self.command(action, execution_id, skills), skill_list or ())
        if answer is None:
            return -1
        if action in (SkillCommandRequest.START, SkillCommandRequest.TICK_ONCE):
            with self._lock:
                self._started = answer
                if answer not in self._ended:
                    self._tasks.setdefault(answer, None)
        return answer

    def _wait_for_monitor(self) -> None:
        """Waits until the manager's messages arrive: otherwise this client might miss the end of a task."""
        deadline = time.monotonic() + _CONNECT_TIMEOUT
        while not self._monitor_sub.get_num_connections() and time.monotonic() < deadline:
            time.sleep(_POLL_PERIOD)

    def tick_once(self, execution_id: int = NEW, skill_list: Sequence[SkillHolder] | None = None) -> int:
        """Ticks a task once and pauses it; with skills, a new task."""
        return self.execute(execution_id, skill_list, SkillCommandRequest.TICK_ONCE)

    def preempt_one(self, execution_id: int | None = None) -> bool:
        """Preempts a task, by default the last one started by this client, else the first running one.

        :returns: False when there is no task or the manager refuses; `last_error` has the reason.
        """
        return self._to_one(execution_id, SkillCommandRequest.PREEMPT)

    def preempt_all(self) -> bool:
        """Preempts all tasks. Returns False when the manager refuses."""
        return self._send(ALL, SkillCommandRequest.PREEMPT)

    def pause_one(self, execution_id: int | None = None) -> bool:
        """Pauses a task; arguments and result as in `preempt_one`."""
        return self._to_one(execution_id, SkillCommandRequest.PAUSE)

    def pause_all(self) -> bool:
        """Pauses all tasks. Returns False when the manager refuses."""
        return self._send(ALL, SkillCommandRequest.PAUSE)

    def _to_one(self, execution_id: int | None, action: str) -> bool:
        if execution_id is None:
            tasks = self.tasks
            execution_id = self._started if self._started in tasks else next(iter(tasks), -1)
        if execution_id < 0:
            self.last_error = f"{action}: no task of {self.name} is known"
            log.error("%s", self.last_error)
            return False
        return self._send(execution_id, action)

    def _send(self, execution_id: int, action: str) -> bool:
        return self.call(lambda task_id: self.command(action, task_id), execution_id) is not None

    def call(self, service: Callable[[Any], Any], msg: Any) -> Any:
        """Calls a service of the manager. Returns None when it does not answer or refuses; the reason is logged."""
        try:
            return service(msg)
        except (rospy.ServiceException, SkirosError) as error:
            self.last_error = str(error)
            log.error("%s: %s", self.name, error)
            return None

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
