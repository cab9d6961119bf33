"""The robots that do the steps of plans: the skill managers that run."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.params import ParamHandler
from skiros2_msgs.msg import SkillProgress
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_skill.ros.skill_run import SkillRun
from skiros2_skill.ros.utils import SkillHolder
from skiros2_task.core.conductor import Ended
from skiros2_task.core.durations import Durations
from skiros2_task.core.jobs import Job
from skiros2_task.core.plan import SkillCall
from skiros2_task.ros.task_message import skill_holder

log = logging.getLogger(__name__)

#: How long a manager that is in the world model is waited for (s).
_PATIENCE = 5.0
_LOOK_PERIOD = 0.2  # s


class Crew(SkillLayerInterface):
    """Finds the skill managers, has them do steps, and tells when they come and go.

    :param author: stands in the managers' logs as who asked.
    :param durations: learns how long steps took.
    """

    def __init__(self, author: str, durations: Durations) -> None:
        self._durations = durations
        self._told: tuple[Callable[[str], None], Callable[[str], None]] | None = None
        self._came = threading.Condition()
        super().__init__(author)

    def follow(self, on_come: Callable[[str], None], on_go: Callable[[str], None]) -> None:
        """Tells from now on the names of managers that come up or go, from a thread of ROS."""
        with self._discovery_lock:
            self._told = on_come, on_go

    def start(self, job: Job, ended: Ended) -> Callable[[], None]:
        """Has a step done, in a thread of its own; see `Robots`."""
        step = _Step(job, ended)
        threading.Thread(target=self._do, args=(step,), name=f"step {job.number}", daemon=True).start()
        return step.stop

    def offered(self, call: SkillCall) -> ParamHandler | None:
        """The parameters of a call's skill as its manager lists them, copied; None where it does not run or list it."""
        try:
            return self.get_agent(call.manager).get_skill(call.label).ph
        except UnknownName as error:
            log.warning("%s is sent with the parameters that the world model has: %s", call, error)
            return None

    def _do(self, step: _Step) -> None:
        try:
            manager = self._find(step.job.call.manager)
            skill = skill_holder(step.job.call, self.offered)
            seconds = step.follow(manager, skill, lambda: self.agents.get(manager.name) is manager)
            if seconds is not None:
                self._durations.learn(step.job.skill, manager.name, seconds)
        except SkirosError as error:
            step.ended(False, str(error), ())
        except Exception as error:
            log.exception("%s", step.job)
            step.ended(False, f"internal error: {type(error).__name__}: {error}", ())

    def _find(self, manager: str) -> SkillManagerInterface:
        """The client of a manager, which may have just come up.

        :raises UnknownName: it does not run.
        """
        with self._came:
            self._came.wait_for(lambda: manager in self.agents, _PATIENCE)
        return self.get_agent(manager)

    # -- called by threads of ROS ------------------------------------------------------------------------------

    def _on_agent(self, name: str) -> None:
        super()._on_agent(name)
        with self._came:
            self._came.notify_all()
        if self._told is not None:
            self._told[0](name)

    def _on_agent_gone(self, name: str) -> None:
        super()._on_agent_gone(name)
        if self._told is not None:
            self._told[1](name)


class _Step:
    """A step that a manager does or is to do. `stop` may be called from any thread, at any time."""

    def __init__(self, job: Job, ended: Ended) -> None:
        self.job = job
        self.ended = ended
        self._lock = threading.Lock()
        self._run: SkillRun | None = None
        self._stopped = False

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            if self._run is not None:
                self._run.cancel()

    def follow(self, manager: SkillManagerInterface, skill: SkillHolder, is_there: Callable[[], bool]) -> float | None:
        """Blocks until the step has ended. Returns how long it took (s), if it has succeeded.

        :param skill: as the manager is to run it.
        :param is_there: whether the manager still runs, in the same life.
        :raises SkirosError: the manager does not answer.
        """
        began = time.monotonic()
        with self._lock:
            if self._stopped:
                raise Refused("stopped before it was started")
        run = manager.run([skill])
        with self._lock:
            self._run = run
            if self._stopped:
                run.cancel()
        while not run.wait(_LOOK_PERIOD):
            if not is_there():
                self.ended(False, f"{manager.name} has disappeared", ())
                return None
        seconds, result = time.monotonic() - began, run.result()
        succeeded = result.state == SkillProgress.SUCCESS
        log.info("%s has ended after %.2f s: %s", self.job, seconds, result.message)
        self.ended(succeeded, result.message, _explanations(run))
        return seconds if succeeded else None


def _explanations(run: SkillRun) -> list[Explanation]:
    try:
        return run.explanations()
    except SkirosError as error:
        log.warning("an explanation cannot be read: %s", error)
        return []
