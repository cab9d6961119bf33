"""The action `~achieve`: plans goals and executes the plans."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from skiros2_common.core.errors import WrongValue
from skiros2_common.ros.goal_server import ACTIVE, GoalServer, is_cancelled
from skiros2_msgs.msg import AchieveAction as AchieveActionSpec
from skiros2_msgs.msg import AchieveActionGoal, AchieveFeedback, AchieveGoal, AchieveResult
from skiros2_msgs.srv import GoalOnRestart, GoalOnRestartRequest, GoalOnRestartResponse
from skiros2_task.core.commands import End
from skiros2_task.core.executor import GoalExecutor
from skiros2_task.core.given_plan import GivenPlan
from skiros2_task.core.goal_execution import Goal, GoalExecution
from skiros2_task.core.goal_report import progress_of, result_of
from skiros2_task.core.goal_store import ENDED_GOALS, GoalStore, OnRestart, StoredGoal, StoreFailed
from skiros2_task.core.planning import Verdict
from skiros2_task.core.recovery import Restart
from skiros2_task.ros.plan_actions import START_DELAY, PlanningOptions, end_goal

log = logging.getLogger(__name__)

#: The default of a goal's `max_replans`.
MAX_REPLANS = 5
#: The default of `interrupt_priority`.
INTERRUPT_PRIORITY = 100
#: How long a client that was restarted can read how its goal has ended (s).
_STATUS_KEPT = 60.0
#: How long after its publication a result counts as delivered (s).
_DELIVERY_TIME = 2.0

#: The status of an ended goal.
_STATUS = {
    Verdict.PLANNED: GoalStatus.SUCCEEDED,
    Verdict.NOTHING_TO_DO: GoalStatus.SUCCEEDED,
    Verdict.CANCELLED: GoalStatus.PREEMPTED,
}


class AchieveAction(GoalServer):
    """Executes any number of goals at once. A goal continues when its client disappears.

    With a store, a goal also continues when the task manager is killed. Call `start`, then `recover`. To be closed
    after the executor.

    :param max_replans: for goals with negative `max_replans`.
    :param interrupt_priority: goals with this priority, or a higher one, interrupt goals with a lower priority.
    :param store: of the goals; None: they are lost with the process.
    :param replans_after_limit: see `Goal`.
    """

    def __init__(
        self, executor: GoalExecutor, options: PlanningOptions, max_replans: int = MAX_REPLANS,
        interrupt_priority: int = INTERRUPT_PRIORITY, store: GoalStore | None = None,
        replans_after_limit: bool = False,
    ) -> None:  # fmt: skip
        super().__init__("~achieve", AchieveActionSpec, _STATUS_KEPT, START_DELAY, ENDED_GOALS)
        self._executor = executor
        self._options = options
        self._max_replans = max_replans
        self._interrupt_priority = interrupt_priority
        self._replans_after_limit = replans_after_limit
        self._store = store
        #: Replaced by the thread of the goals, never changed.
        self._running: tuple[tuple[Any, GoalExecution], ...] = ()
        self._recovered: list[tuple[GoalExecution, StoredGoal]] = []
        if store is not None:
            self._restore(store)
        else:
            self._server.unknown_status = GoalStatus.LOST

    def _restore(self, store: GoalStore) -> None:
        """Lists the goals of an earlier process, and keeps its results."""
        for ended in store.results():
            status = GoalStatus(_goal_id(ended.id, ended.request), ended.status, ended.text)
            self.restore_result(status, AchieveResult(**ended.result), ended.delivered)
        for stored in store.open_goals():
            message = AchieveGoal(**stored.request["goal"])
            action_goal = AchieveActionGoal(goal_id=_goal_id(stored.id, stored.request), goal=message)
            handle = self.restore(action_goal, "continued after a restart")
            publisher = _GoalPublisher(handle, self._keep)
            try:
                goal = self._goal(message, stored.id)
            except WrongValue as error:  # the options of the task manager are others now
                goal = Goal(message.goals, message.priority, id=stored.id)
                log.warning("goal %s continues with other options: %s", stored.id, error)
            execution = self._executor.prepare(goal, publisher.on_change, publisher.on_end)
            self._running = (*self._running, (handle, execution))
            self._recovered.append((execution, stored))

    def recover(self, restart: Restart) -> None:
        """Continues the goals of an earlier process."""
        if self._recovered:
            log.warning("%d goals of an earlier process continue", len(self._recovered))
        self._executor.recover(self._recovered, restart)
        self._recovered = []

    def set_on_restart(self, request: GoalOnRestartRequest) -> GoalOnRestartResponse:
        """Serves `~on_restart`."""
        if self._store is None:
            return GoalOnRestartResponse(False, "goals are not stored: see the parameter ~goals")
        try:
            self._store.set_on_restart(request.goal_id, OnRestart.named(request.on_restart))
        except (WrongValue, StoreFailed) as error:
            return GoalOnRestartResponse(False, str(error))
        for handle, execution in self._running:
            if handle.get_goal_id().id == request.goal_id:
                self._executor.decide(execution)
        return GoalOnRestartResponse(True, "")

    def _is_empty(self, goal: Any) -> bool:
        return not goal.goals.strip()

    def _repeat(self, goal_id: str) -> None:
        for handle, execution in self._running:
            if handle.get_goal_id().id == goal_id:
                self._executor.report(execution)

    def start(self) -> None:
        super().start()
        self._service = rospy.Service("~on_restart", GoalOnRestart, self.set_on_restart)

    def close(self, timeout: float = 1.0) -> None:
        unfinished = [handle for handle, _ in self._running if handle.get_goal_status().status in ACTIVE]
        super().close(timeout)
        for handle in unfinished:
            status, result = handle.get_goal_status(), self._unserved_result(False, "")
            result.message = status.text
            self._keep(handle.get_goal_id().id, status.status, result)

    def _keep(self, goal_id: str, status: int, result: Any) -> None:
        """Stores the result of a goal, so that it is known after a restart."""
        store = self._store
        if store is None:
            return
        try:
            store.end(goal_id, status, result.message, {name: getattr(result, name) for name in result.__slots__})
        except StoreFailed as error:
            log.error("the result of the goal %s is not stored: %s", goal_id, error)
        self._executor.put(lambda: self._executor.after(_DELIVERY_TIME, lambda: store.note_delivered(goal_id)))

    def _unserved_result(self, cancelled: bool, message: str) -> Any:
        return _refusal(AchieveResult.CANCELLED if cancelled else AchieveResult.FAILED, message)

    def _unfinished_handles(self) -> list[Any]:
        return [handle for handle, _ in self._running]

    # -- in the threads of the action --------------------------------------------------------------------------

    def _begin(self, handle: Any) -> None:
        message, goal_id = handle.get_goal(), handle.get_goal_id()
        try:
            goal = self._goal(message, goal_id.id)
            if self._store is not None:
                request = {
                    "goal": {name: getattr(message, name) for name in message.__slots__},
                    "stamp": [goal_id.stamp.secs, goal_id.stamp.nsecs],
                }
                if not self._store.accept(goal_id.id, request):
                    raise WrongValue(f"the id {goal_id.id} is the one of an earlier goal")
        except (WrongValue, StoreFailed) as error:
            log.warning("goal of %s is rejected: %s", message.author or "unknown", error)
            handle.set_rejected(_refusal(AchieveResult.FAILED, str(error)), str(error))
            return
        handle.set_accepted()
        log.info("goal of %s: %s", message.author or "unknown", message.goals)
        publisher = _GoalPublisher(handle, self._keep)
        execution = self._executor.achieve(goal, publisher.on_change, publisher.on_end)
        active = [(h, a) for h, a in self._running if h.get_goal_status().status in ACTIVE]
        self._running = (*active, (handle, execution))
        if is_cancelled(handle):
            self._executor.cancel(execution)

    def _cancel(self, handle: Any) -> None:
        for known, execution in self._running:
            if known == handle:
                self._executor.cancel(execution)

    def _goal(self, message: Any, goal_id: str) -> Goal:
        """
        :raises WrongValue: a field has an invalid value.
        """
        planner = self._options.planner(message.wish)
        max_replans = message.max_replans if message.max_replans >= 0 else self._max_replans
        return Goal(
            text=message.goals,
            priority=message.priority,
            limits=self._options.limits(message.seconds),
            planner=planner,
            max_replans=0 if isinstance(planner, GivenPlan) else max_replans,
            interrupts=message.priority >= self._interrupt_priority,
            id=goal_id if self._store is not None else "",
            replans_after_limit=self._replans_after_limit,
        )


class _GoalPublisher:
    """Publishes feedback and result of one goal, from the executor's thread."""

    def __init__(self, handle: Any, keep: Callable[[str, int, Any], None]) -> None:
        """
        :param keep: stores the result of a goal with its status, by its id.
        """
        self._handle = handle
        self._keep = keep

    def on_change(self, execution: GoalExecution) -> None:
        self._handle.publish_feedback(AchieveFeedback(**vars(progress_of(execution))))

    def on_end(self, execution: GoalExecution, end: End) -> None:
        result = AchieveResult(**vars(result_of(execution, end)))
        self._keep(execution.goal.id, _STATUS.get(end.verdict, GoalStatus.ABORTED), result)
        end_goal(self._handle, end.verdict, result, end.message)


def _goal_id(goal_id: str, request: dict[str, Any]) -> Any:
    return GoalID(rospy.Time(*request["stamp"]), goal_id)


def _refusal(state: str, message: str) -> Any:
    return AchieveResult(state=state, message=message, done="[]", explanations="[]")
