"""The action `~execute`: each goal is a task of its own."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.params import Param
from skiros2_common.ros.goal_server import GoalServer
from skiros2_msgs import msg as msgs
from skiros2_skill.core.history import Record, record_of
from skiros2_skill.core.task import Task
from skiros2_skill.core.ticker import Ticker
from skiros2_skill.ros.progress import WIRE_STATES, param_messages, wire_code, wire_text
from skiros2_skill.ros.skill_run import MOST_AT_ONCE
from skiros2_skill.ros.task_starter import TaskRefused, TaskStarter, explanations_json

log = logging.getLogger(__name__)


@dataclass
class _Goal:
    """
    :param told: how often the task had changed when feedback was given last.
    """

    handle: Any
    told: int = -1


class ExecuteAction(GoalServer):
    """Runs goals as tasks, any number side by side, and cancels each by itself.

    A client that disappears leaves its task running: it is there to be seen on `~monitor` and to be preempted.

    `close` is for when the tasks have ended.

    :param starter: makes the tasks.
    :param ticker: runs them.
    """

    def __init__(self, starter: TaskStarter, ticker: Ticker) -> None:
        super().__init__("~execute", msgs.ExecuteSkillsAction, MOST_AT_ONCE)
        self._starter = starter
        self._ticker = ticker
        self._lock = threading.Lock()  # never held in a call of actionlib
        self._goals: dict[int, _Goal] = {}  # by the id of the task

    def _unfinished_handles(self) -> list[Any]:
        with self._lock:
            left, self._goals = self._goals, {}
        return [goal.handle for goal in left.values()]

    # -- progress, in the ticking threads ----------------------------------------------------------------------

    def wants(self, task: Task) -> bool:
        """Whether somebody is to be told how a task goes on."""
        goal = self._goal(task)
        return goal is not None and goal.told != task.changes and self.has_subscribers

    def tell(self, task: Task, progress: Sequence[Any]) -> None:
        """Gives feedback to the client of a task, if it has one and something has changed."""
        goal = self._goal(task)
        if progress and goal is not None and goal.told != task.changes:
            goal.told = task.changes
            goal.handle.publish_feedback(msgs.ExecuteSkillsFeedback(task.id, progress))

    def end(self, task: Task, record: Record) -> None:
        """Answers the client of a task that has ended, if it has one."""
        with self._lock:
            goal = self._goals.pop(task.id, None)
        if goal is None:
            return
        handle, result = goal.handle, _result(record, _outputs(task))
        if record.state is State.Success:
            handle.set_succeeded(result, result.message)
        elif record.preempted:
            handle.set_canceled(result, result.message)
        else:
            handle.set_aborted(result, result.message)

    def _goal(self, task: Task) -> _Goal | None:
        with self._lock:
            return self._goals.get(task.id)

    # -- goals, in the thread of the action --------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        goal = handle.get_goal()
        try:
            task = self._starter.make(goal.author, goal.skills)
        except TaskRefused as refused:
            log.warning("execute by %s refused: %s", goal.author or "unknown", refused)
            result = _result(refused.record, {})
            handle.set_rejected(result, result.message)
            return
        handle.set_accepted(f"task {task.id}")
        with self._lock:
            self._goals[task.id] = _Goal(handle)
        log.info("execute by %s: task %s", goal.author or "unknown", task.id)
        try:
            self._ticker.start(task.id)
        except Refused:
            log.debug("task %s runs already", task.id)
        except UnknownName:  # all tasks were preempted just now
            self.end(task, record_of(task))

    def _cancel(self, handle: Any) -> None:
        with self._lock:
            ids = [task_id for task_id, goal in self._goals.items() if goal.handle == handle]
        for task_id in ids:
            try:
                self._ticker.preempt(task_id)
            except UnknownName:
                log.debug("task %s has ended already", task_id)
            else:
                log.info("task %s is cancelled", task_id)


def _outputs(task: Task) -> dict[str, Param]:
    """The task's blackboard and, where it has no value, the parameters of the skills that ran."""
    params: dict[str, Param] = {}
    for node in task.root.children:
        if node.state is not State.Idle:
            params.update(node.params.getParamMap())
    params.update((key, param) for key, param in task.root.params.getParamMap().items() if param.is_bound())
    return {key: param for key, param in params.items() if param.is_bound()}


def _result(record: Record, params: dict[str, Param]) -> Any:
    failed = msgs.SkillProgress.FAILURE
    return msgs.ExecuteSkillsResult(
        task_id=record.task_id,
        state=WIRE_STATES[record.state] if record.state is State.Success else failed,
        code=wire_code(record.code),
        message=wire_text(record.message),
        params=param_messages(params),
        explanation=explanations_json(record.explanations),
    )
