"""Runs the steps of plans on skill managers."""

from __future__ import annotations

import logging
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from uuid import uuid4

import rospy

from skiros2_common.core.errors import Refused, SkirosError, UnknownName
from skiros2_common.core.explanation import Explanation, cause_of
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.params import ParamHandler
from skiros2_msgs.msg import SkillProgress
from skiros2_skill.client.manager import ManagerClient
from skiros2_skill.client.port import explain
from skiros2_skill.client.skill_goal import SkillGoal
from skiros2_skill.ros.registration import ROBOT_PARAMETER
from skiros2_skill.ros.skill_layer_interface import SkillLayerInterface
from skiros2_skill.ros.skill_manager_interface import SkillManagerInterface
from skiros2_skill.ros.utils import SkillHolder
from skiros2_task.core.goal_execution import Began, Ended
from skiros2_task.core.plan import SkillCall, Step
from skiros2_task.core.recovery import ROBOTS_TIMEOUT
from skiros2_task.core.store import Durations
from skiros2_task.ros.task_message import skill_holder

log = logging.getLogger(__name__)

#: How long to wait for a manager that is in the world model, before a step (s).
_MANAGER_TIMEOUT = 5.0
#: How long to wait for such managers before planning (s): two discovery periods.
_DISCOVERY_TIMEOUT = 2.0
_POLL_PERIOD = 0.2  # s
#: How often a step that does not stop is reported (s).
_REPORT_PERIOD = 10.0


class ManagerStepRunner(SkillLayerInterface):
    """Discovers skill managers, runs steps on them, and reports when managers appear and disappear.

    Steps of a manager that disappears count as failed. If it was only silent, they still run when it answers again:
    they are stopped before it counts as running, so that no step of a new plan runs beside them.

    :param author: the author of the tasks, in the managers' logs.
    :param durations: records the durations of successful steps.
    """

    def __init__(self, author: str, durations: Durations) -> None:
        self._durations = durations
        self._callbacks: tuple[Callable[[str], None], Callable[[str], None]] | None = None
        self._discovered = threading.Condition()
        self._absent: set[str] = set()  # names of managers that were not discovered in time
        #: The ids of the runs whose end is unknown, by manager. Each change is one call, so without a lock.
        self._runs: defaultdict[str, set[str]] = defaultdict(set)
        self._returning: dict[str, ManagerClient] = {}  # of managers that still run such steps
        super().__init__(author)

    def subscribe(self, on_found: Callable[[str], None], on_lost: Callable[[str], None]) -> None:
        """Reports the names of the managers that run, then of those that appear or disappear, from a ROS thread."""
        with self._discovery_lock:
            self._callbacks = on_found, on_lost
            for name in self.agents:
                on_found(name)

    def robots(self, named: Collection[str]) -> dict[str, str]:
        """Returns the ids of the robots that the running managers have registered, by manager; "" if unknown.

        Waits for managers that are not discovered yet, once for each; unless no manager runs at all.

        :param named: the names of managers in the scene.
        """

        def missing() -> set[str]:
            agents = self.agents
            return {name for name in named if not matching_name(name, agents)} if agents else set()

        with self._discovered:
            self._discovered.wait_for(lambda: missing() <= self._absent, _DISCOVERY_TIMEOUT)
            self._absent |= missing()
        return {name: _robot_of(name) for name in self.agents}

    def start(
        self, step: Step, ended: Ended, run: str = "", began: Began | None = None, goal: str = ""
    ) -> Callable[[], None]:
        """Runs a step in a new thread; see `StepRunner`."""
        started = _StepRun(step, ended, run, began, goal)
        threading.Thread(target=self._run, args=(started,), name=f"step {step.number}", daemon=True).start()
        return started.stop

    def attach(
        self, step: Step, run: str, known: Callable[[bool], None], ended: Ended, began: Began | None = None
    ) -> Callable[[], None]:
        """Follows a step in a new thread; see `StepRunner`."""
        attached = _StepRun(step, ended, run, began)
        threading.Thread(target=self._attach, args=(attached, known), name=f"step {step.number}", daemon=True).start()
        return attached.stop

    def offered(self, call: SkillCall) -> ParamHandler | None:
        """Returns a copy of the skill's parameters as its manager lists them; None if the manager does not list it."""
        try:
            return self.get_agent(call.manager).get_skill(call.label).ph
        except UnknownName as error:
            log.warning("%s is sent with the parameters in the world model: %s", call, error)
            return None

    def _run(self, run: _StepRun) -> None:
        try:
            manager = self._find(run.step.call.manager)
            skill = skill_holder(run.step.call, self.offered)
            with self._noted(run, manager):
                seconds = run.execute(manager, skill, lambda: self.agents.get(manager.name) is manager)
            if seconds is not None:
                self._durations.record(run.step.skill, manager.name, seconds)
        except SkirosError as error:
            run.abandon()
            run.ended(False, str(error), ())
        except Exception as error:
            run.abandon()
            log.exception("%s", run.step)
            run.ended(False, f"internal error: {type(error).__name__}: {error}", ())

    def _attach(self, run: _StepRun, known: Callable[[bool], None]) -> None:
        deadline = time.monotonic() + ROBOTS_TIMEOUT
        while True:
            try:
                manager = self._find(run.step.call.manager, deadline - time.monotonic())
                is_known = run.attach(manager)
                break
            except SkirosError as error:  # it may be starting
                log.info("%s: %s", run.step, error)
                if time.monotonic() >= deadline:
                    known(False)
                    return
        known(is_known)
        if not is_known:
            return
        try:
            with self._noted(run, manager):
                run.follow(manager, lambda: self.agents.get(manager.name) is manager)
        except SkirosError as error:
            run.abandon()
            run.ended(False, str(error), ())

    @contextmanager
    def _noted(self, run: _StepRun, manager: SkillManagerInterface) -> Iterator[None]:
        """Notes a run until its end is known."""
        self._runs[manager.name].add(run.id)
        try:
            yield
        finally:
            if not run.may_run:
                self._runs[manager.name].discard(run.id)

    def _find(self, manager: str, timeout: float = _MANAGER_TIMEOUT) -> SkillManagerInterface:
        """Returns the client of a manager, waiting for one that is not discovered yet.

        :raises UnknownName: the manager does not run.
        """
        with self._discovered:
            self._discovered.wait_for(lambda: manager in self.agents, max(0.0, timeout))
        return self.get_agent(manager)

    # -- called by ROS threads ---------------------------------------------------------------------------------

    def _on_agent(self, name: str) -> None:
        left = self._runs[name].copy()
        if left:
            self._returning[name] = client = ManagerClient(name, self._author)
            threading.Thread(target=self._stop_steps, args=(client, left), name=f"steps of {name}", daemon=True).start()
        else:
            self._add(name)

    def _on_agent_gone(self, name: str) -> None:
        client = self._returning.pop(name, None)
        if client is not None:
            client.close()
            return
        super()._on_agent_gone(name)
        if self._callbacks is not None:
            self._callbacks[1](name)

    def _add(self, name: str) -> None:
        super()._on_agent(name)
        with self._discovered:
            self._absent.clear()
            self._discovered.notify_all()
        if self._callbacks is not None:
            self._callbacks[0](name)

    # -- a thread of a manager that has returned ---------------------------------------------------------------

    def _stop_steps(self, manager: ManagerClient, runs: set[str]) -> None:
        for run in runs:
            while self._returning.get(manager.name) is manager:
                try:
                    _stop_step(manager, run)
                    break
                except (SkirosError, rospy.ROSException) as error:  # the latter: its connections are closed
                    log.warning("%s may still run a step from before it was silent: %s", manager.name, error)
        with self._discovery_lock:
            if self._returning.get(manager.name) is manager:
                del self._returning[manager.name]
                manager.close()
                self._runs[manager.name].difference_update(runs)
                self._add(manager.name)


def _stop_step(manager: ManagerClient, run_id: str) -> None:
    """Stops a step, and waits for its end. Nothing happens if the manager does not know it: it was restarted."""
    run = manager.attach(run_id)
    if run.wait_until_known() and not run.done:
        log.warning("%s was silent, and still runs a step: it is stopped", manager.name)
        run.cancel()
        while not run.wait(_REPORT_PERIOD):
            log.warning("%s gets no further steps: a step from before it was silent does not end", manager.name)


def _robot_of(manager: str) -> str:
    """Returns the id of the robot that a manager has registered; "" if unknown."""
    try:
        robot = rospy.get_param_cached(f"{manager}/{ROBOT_PARAMETER}", "")
    except (OSError, rospy.ROSException) as error:
        log.warning("the robot of %s is unknown: the master does not answer: %s", manager, error)
        return ""
    return robot if isinstance(robot, str) else ""


class _StepRun:
    """A run of a step on a manager. `stop` may be called by any thread, also before the run."""

    def __init__(self, step: Step, ended: Ended, run_id: str, began: Began | None, goal: str = "") -> None:
        self.step = step
        self.ended = ended
        self.id = run_id or uuid4().hex
        self._began = began
        self._goal = goal
        self._lock = threading.Lock()
        self._run: SkillGoal | None = None
        self._stopped = False

    @property
    def may_run(self) -> bool:
        """Whether it was sent, and its end is unknown."""
        return self._run is not None and not self._run.done

    def stop(self) -> None:
        with self._lock:
            self._stopped = True
            if self._run is not None:
                self._run.cancel()

    def abandon(self) -> None:
        """Stops a step whose result is lost: its task may still run, and would do so beside a new plan."""
        with suppress(rospy.ROSException):  # the manager has gone meanwhile: its connections are closed
            self.stop()

    def execute(self, manager: SkillManagerInterface, skill: SkillHolder, is_alive: Callable[[], bool]) -> float | None:
        """Blocks until the step has ended. Returns its duration (s); None if it failed.

        :param skill: the skill with its parameters.
        :param is_alive: whether the manager still runs and was not restarted.
        :raises SkirosError: the manager does not answer.
        """
        started = time.monotonic()
        with self._lock:
            if self._stopped:
                raise Refused("stopped before it was started")
        note = lambda feedback: self._report(feedback.task_id)  # noqa: E731
        self._set(manager.run([skill], note, goal_id=self.id, goal=self._goal))
        return time.monotonic() - started if self.follow(manager, is_alive) else None

    def attach(self, manager: SkillManagerInterface) -> bool:
        """Asks the manager for the step of another process. Returns whether it has it.

        :raises TimedOut: the manager does not answer.
        """
        run = manager.attach(self.id)
        is_known = run.wait_until_known(_MANAGER_TIMEOUT)
        if is_known:
            self._set(run)
        return is_known

    def _report(self, task: int) -> None:
        """Reports the number of the task, once. Any thread."""
        with self._lock:
            began, self._began = (self._began, None) if task >= 0 else (None, self._began)
        if began is not None:
            began(task)

    def _set(self, run: SkillGoal) -> None:
        with self._lock:
            self._run = run
            if self._stopped:
                run.cancel()

    def follow(self, manager: SkillManagerInterface, is_alive: Callable[[], bool]) -> bool:
        """Blocks until the step has ended. Returns whether it has succeeded.

        :param is_alive: see `execute`.
        :raises SkirosError: the manager does not answer.
        """
        started, run = time.monotonic(), self._run
        assert run is not None
        while not run.wait(_POLL_PERIOD):
            self._report(run.task)
            if not is_alive():
                self.ended(False, f"{manager.name} has disappeared", ())
                return False
        seconds, result = time.monotonic() - started, run.result()
        self._report(run.task)
        succeeded = result.state == SkillProgress.SUCCESS
        log.info("%s has ended after %.2f s: %s", self.step, seconds, result.message)
        explanations = _explanations(manager, run)
        self.ended(succeeded, result.message if succeeded else cause_of(explanations, result.message), explanations)
        return succeeded


def _explanations(manager: SkillManagerInterface, run: SkillGoal) -> list[Explanation]:
    try:
        return explain(manager, run)
    except SkirosError as error:
        log.warning("an explanation cannot be read: %s", error)
        return []
