"""Primitives that use an action server, with servers in one process."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import actionlib
import pytest
from actionlib_msgs.msg import GoalStatus

from compatibility.rules import rule
from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_msgs.msg import AssignTaskAction, AssignTaskGoal, AssignTaskResult
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient

pytestmark = [pytest.mark.usefixtures("ros_master"), pytest.mark.timeout(120)]

_numbers = itertools.count()


class Job(SkillDescription):
    pass


class do_job(PrimitiveActionClient):
    """As libraries write it."""

    action = "/nobodys_job"
    goal = "good"

    def createDescription(self) -> None:
        self.setDescription(Job(), self.__class__.__name__)

    def buildClient(self) -> Any:
        return actionlib.SimpleActionClient(self.action, AssignTaskAction)

    def buildGoal(self) -> Any:
        return AssignTaskGoal(goals=self.goal)


class Server:
    """Succeeds, aborts the goal `bad`, and works on `long` until it is cancelled."""

    def __init__(self) -> None:
        self.name = f"/compatible_job_{next(_numbers)}"
        self.goals: list[str] = []
        self.cancelled = threading.Event()
        self.closed = threading.Event()
        self._server = actionlib.SimpleActionServer(self.name, AssignTaskAction, self._work, auto_start=False)
        self._server.start()

    def _work(self, goal: Any) -> None:
        self.goals.append(goal.goals)
        if goal.goals == "long":
            while not self._server.is_preempt_requested() and not self.closed.wait(0.01):
                pass
            self.cancelled.set()
            self._server.set_preempted()
        elif goal.goals == "bad":
            self._server.set_aborted(AssignTaskResult(progress_code=1), text="no way")
        else:
            self._server.set_succeeded(AssignTaskResult(progress_code=3, progress_message="made"), text="done")


@pytest.fixture
def server() -> Iterator[Server]:
    server = Server()
    yield server
    server.closed.set()


def started(skill: type, **attributes: Any) -> Any:
    made = skill()
    for name, value in attributes.items():
        setattr(made, name, value)
    assert made.init(None)
    made.start()
    return made


def run(skill: Any, until: Callable[[], bool] = lambda: False, timeout: float = 15.0) -> State:
    """Ticks a started skill until it ends or the condition holds."""
    end = time.monotonic() + timeout
    state = skill.state
    while state is State.Running and not until():
        assert time.monotonic() < end, skill.progress_msg
        state = skill.tick()
        time.sleep(0.01)
    return state


@rule(
    "robots",
    "`PrimitiveActionClient` without a server fails with `Action server <ns> is not available.`, code -101, within "
    "10 s",
    better="no hook waits: the tree continues meanwhile",
)
def test_a_missing_server_fails_within_ten_seconds() -> None:
    began_at = time.monotonic()
    skill = started(do_job)
    assert skill.tick() is State.Running
    assert time.monotonic() - began_at < 0.5
    assert run(skill) is State.Failure
    assert time.monotonic() - began_at < 10.0
    assert (skill.progress_msg, skill.progress_code) == ("Action server /nobodys_job is not available.", -101)


@rule("robots", "`onPreempt` cancels all goals; the state is Success, the message `Stopped`")
def test_preemption_cancels_all_goals(server: Server) -> None:
    skill = started(do_job, action=server.name, goal="long")
    run(skill, until=lambda: bool(server.goals))
    assert skill.preempt() is State.Success
    assert skill.progress_msg == "Stopped"
    assert server.cancelled.wait(5)


@rule("robots", "`get_result_msg()` returns the result message of the client")
def test_the_result_message_is_that_of_the_client(server: Server) -> None:
    class tell(do_job):
        def onDone(self, status: int, msg: Any) -> State:
            return self.success(f"{self.get_result_msg().progress_message} {msg.progress_code}")

    skill = started(tell, action=server.name)
    assert run(skill) is State.Success
    assert skill.progress_msg == "made 3"


@rule("robots", "`restart(goal, text)` sends the goal and returns Running")
def test_restart_sends_another_goal(server: Server) -> None:
    class twice(do_job):
        def onDone(self, status: int, msg: Any) -> State:
            if len(server.goals) < 2:
                return self.restart(AssignTaskGoal(goals="again"), "once more")
            return self.success("twice")

    skill = started(twice, action=server.name)
    assert run(skill, until=lambda: skill.progress_msg == "once more") is State.Running
    assert run(skill) is State.Success
    assert server.goals == ["good", "again"]


@rule(
    "robots",
    "`buildClient` and `buildGoal` return None by default",
    better="a start fails then and names the missing one",
)
def test_build_client_and_build_goal_return_none_by_default(server: Server) -> None:
    class bare(PrimitiveActionClient):
        def createDescription(self) -> None:
            self.setDescription(Job(), "bare")

    assert bare().buildClient() is None
    assert bare().buildGoal() is None
    skill = started(bare)
    assert (skill.progress_msg, skill.progress_code) == ("bare.buildClient gave no client", -101)

    class goalless(do_job):
        def buildGoal(self) -> None:
            return None

    assert started(goalless, action=server.name).progress_msg == "goalless.buildGoal gave no goal"


@rule(
    "robots",
    "The default `onDone` ends the skill",
    differs="it fails unless the goal has succeeded; override `onDone` to take other ends for a success",
)
def test_by_default_only_a_goal_that_succeeds_is_a_success(server: Server) -> None:
    assert run(started(do_job, action=server.name)) is State.Success
    skill = started(do_job, action=server.name, goal="bad")
    assert run(skill) is State.Failure
    assert (skill.progress_msg, skill.progress_code) == ("no way", -GoalStatus.ABORTED)
