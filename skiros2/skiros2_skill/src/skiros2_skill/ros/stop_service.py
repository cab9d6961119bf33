"""The service `~stop` of a skill manager: preempts, pauses and resumes tasks, by a deadline or not at all."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import rospy

from skiros2_common.core.errors import Refused, SkirosError, TimedOut, UnknownName
from skiros2_common.core.wording import short_name
from skiros2_msgs import srv as srvs
from skiros2_skill.core.runtime.scheduler import Scheduler

log = logging.getLogger(__name__)

#: How long a pause waits for the tick in progress (s); limited because a hook may send the command.
PAUSE_TIMEOUT = 0.5

#: The task id in a command for all tasks.
ALL = -1

_ACTIONS = (srvs.SkillStopRequest.PREEMPT, srvs.SkillStopRequest.PAUSE, srvs.SkillStopRequest.RESUME)


class StopService:
    """Carries out the requests.

    :param catch_up: updates the world model before tasks are resumed; may block.
    :param clock: returns the time (s) of deadlines.
    """

    def __init__(
        self, scheduler: Scheduler, catch_up: Callable[[], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._scheduler = scheduler
        self._catch_up = catch_up
        self._clock = clock

    def offer(self) -> Any:
        """Offers the service, which is returned."""
        return rospy.Service("~stop", srvs.SkillStop, self.handle)

    def handle(self, request: Any) -> Any:
        """Carries out a request."""
        author = short_name(request.author or "unknown")
        try:
            tasks = self._apply(request)
        except SkirosError as error:
            text = f"{short_name(request.action)} by {author} refused: {error}"
            log.warning("%s", text)
            return srvs.SkillStopResponse(False, error.code, text, [], self._clock())
        if request.action:
            log.info("%s by %s: tasks %s", request.action, author, ", ".join(map(str, tasks)) or "none")
        return srvs.SkillStopResponse(True, "", "", tasks, self._clock())

    def _apply(self, request: Any) -> list[int]:
        """Returns the tasks concerned.

        :raises SkirosError: nothing was done.
        """
        if request.action == request.CLOCK:
            return []
        if request.action not in _ACTIONS:
            raise UnknownName(f"unknown action {short_name(request.action)!r}, expected one of: {', '.join(_ACTIONS)}")
        if request.task_id < ALL:
            raise UnknownName(f"no task {request.task_id} is here; ids begin at 0, and -1 means all")
        self._check(request.deadline)
        if request.action == request.RESUME:
            self._catch_up()
            self._check(request.deadline)
            return self._resume(request.task_id)
        tasks = [task.id for task in self._scheduler.tasks()] if request.task_id == ALL else [request.task_id]
        if request.action == request.PREEMPT:
            preempt, preempt_all = self._scheduler.preempt, self._scheduler.preempt_all
            by = request.author
            self._for_tasks(request.task_id, partial(preempt, by=by), partial(preempt_all, by=by))
        else:
            self._for_tasks(request.task_id, self._scheduler.pause, self._scheduler.pause_all)
            self._scheduler.wait_until_idle(tasks, PAUSE_TIMEOUT)
        return tasks

    def _resume(self, task_id: int) -> list[int]:
        if task_id != ALL:
            self._scheduler.start(task_id)
            return [task_id]
        resumed, refusals = [], []
        for paused in self._scheduler.paused():
            try:
                self._scheduler.start(paused)
            except (Refused, UnknownName) as error:  # also: it has just ended, or runs already
                refusals.append(error)
            else:
                resumed.append(paused)
        if refusals and not resumed:
            raise refusals[0]
        return resumed

    @staticmethod
    def _for_tasks(task_id: int, one: Callable[[int], None], all_tasks: Callable[[], None]) -> None:
        if task_id == ALL:
            all_tasks()
        else:
            one(task_id)

    def _check(self, deadline: float) -> None:
        """
        :raises TimedOut: the deadline has passed, or is not a number.
        """
        late = self._clock() - deadline
        if not late <= 0.0:
            raise TimedOut(f"its deadline was {late:.3f} s ago")
