"""The action `~execute`: each goal is a task."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, RobotStopped, UnknownName
from skiros2_common.core.params import Param
from skiros2_common.ros.goal_server import GoalServer, is_cancelled
from skiros2_msgs import msg as msgs
from skiros2_skill.core.runtime.history import Record, outputs_of, record_of
from skiros2_skill.core.runtime.request import TaskRefused, TaskStarter
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.ros.messages import (
    WIRE_STATES,
    explanations_json,
    param_messages,
    skill_request,
    wire_code,
    wire_text,
)

log = logging.getLogger(__name__)

#: The number of results kept for clients that were restarted.
_RESULTS_KEPT = 200


@dataclass
class _Goal:
    """
    :param revision: of the task at the last feedback.
    """

    handle: Any
    revision: int = -1


class ExecuteAction(GoalServer):
    """Runs any number of goals in parallel, each as a task that can be cancelled separately.

    The task of a client that disappears keeps running: it is published on `~monitor` and can be preempted.
    Call `close` after all tasks have ended.

    :param starter: creates the tasks.
    :param scheduler: ticks them.
    """

    def __init__(self, starter: TaskStarter, scheduler: Scheduler) -> None:
        super().__init__("~execute", msgs.ExecuteSkillsAction, results_kept=_RESULTS_KEPT)
        self._starter = starter
        self._scheduler = scheduler
        self._lock = threading.Lock()  # never held in a call of actionlib
        self._goals: dict[int, _Goal] = {}  # by task id

    def _is_empty(self, goal: Any) -> bool:
        return not goal.skills

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        return msgs.ExecuteSkillsResult(-1, msgs.SkillProgress.FAILURE, -1, message, [], "[]")

    def _unfinished_handles(self) -> list[Any]:
        with self._lock:
            goals, self._goals = self._goals, {}
        return [goal.handle for goal in goals.values()]

    # -- progress, in the ticking threads ----------------------------------------------------------------------

    def needs_feedback(self, task: Task) -> bool:
        """Whether feedback on a task is to be published."""
        goal = self._goal(task)
        return goal is not None and goal.revision != task.revision and self.has_subscribers

    def publish_feedback(self, task: Task, progress: Sequence[Any]) -> None:
        """Publishes feedback on a task, if it is a goal and has changed."""
        goal = self._goal(task)
        if progress and goal is not None and goal.revision != task.revision:
            goal.revision = task.revision
            goal.handle.publish_feedback(msgs.ExecuteSkillsFeedback(task.id, progress))

    def end(self, task: Task, record: Record) -> None:
        """Publishes the result of an ended task, if it is a goal."""
        with self._lock:
            goal = self._goals.pop(task.id, None)
        if goal is None:
            return
        handle, result = goal.handle, _result(record, outputs_of(task))
        if record.state is State.Success:
            handle.set_succeeded(result, result.message)
        elif record.preempted:
            handle.set_canceled(result, result.message)
        else:
            handle.set_aborted(result, result.message)

    def _goal(self, task: Task) -> _Goal | None:
        with self._lock:
            return self._goals.get(task.id)

    # -- goals, in the threads of the action -------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        goal = handle.get_goal()
        try:
            task = self._starter.make(goal.author, [skill_request(skill) for skill in goal.skills], goal.goal)
        except TaskRefused as refused:
            log.warning("execute by %s refused: %s", goal.author or "unknown", refused)
            result = _result(refused.record, {})
            handle.set_rejected(result, result.message)
            return
        handle.set_accepted(f"task {task.id}")
        with self._lock:
            self._goals[task.id] = _Goal(handle)
        log.info("execute by %s: task %s", goal.author or "unknown", task.id)
        if is_cancelled(handle):
            self._scheduler.discard(task)
            with self._lock:
                self._goals.pop(task.id, None)
            handle.set_canceled(None, "cancelled before its start")
            return
        try:
            self._scheduler.start(task.id)
        except RobotStopped as stopped:  # just now
            self.end(task, self._starter.withdraw(task, stopped).record)
        except Refused:
            log.debug("task %s runs already", task.id)
        except UnknownName:  # all tasks have just been preempted
            self.end(task, record_of(task))

    def _cancel(self, handle: Any) -> None:
        with self._lock:
            ids = [task_id for task_id, goal in self._goals.items() if goal.handle == handle]
        for task_id in ids:
            try:
                self._scheduler.preempt(task_id, by=handle.get_goal().author)
            except UnknownName:
                log.debug("task %s has ended already", task_id)
            else:
                log.info("task %s is cancelled", task_id)


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
