"""The client primitives of the standard skills, with action and service servers in one process."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import actionlib
import pytest
import rospy
from actionlib.action_client import ActionClient, GoalManager
from actionlib_msgs.msg import GoalStatus
from std_srvs.srv import SetBool, SetBoolRequest, SetBoolResponse

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_msgs.msg import AssignTaskAction, AssignTaskFeedback, AssignTaskGoal, AssignTaskResult, SafetyStatus
from skiros2_skill.core.library.library import SkillLibrary
from skiros2_skill.core.runtime.safety import Safety
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.core.runtime.task import Task
from skiros2_skill.core.tree.skill_node import SkillWrapper
from skiros2_skill.ros.safety import SAFETY_TOPIC
from skiros2_std_skills import action_client_primitive
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_std_skills.recovery import recover_from_stop
from skiros2_std_skills.service_client_primitive import PrimitiveServiceClient
from skiros2_world_model.core.local_world_model import LocalWorldModel
from support.ros import wait_until

pytestmark = pytest.mark.usefixtures("ros_master")


class Job(SkillDescription):
    pass


_numbers = itertools.count()


class job_action(PrimitiveActionClient):
    """Sends the text in `wish`; remembers what it hears."""

    wish = "good"
    action = "/job"

    def createDescription(self) -> None:
        self.setDescription(Job(), "job_action")
        self.heard: list[str] = []

    def buildClient(self) -> actionlib.SimpleActionClient:
        return actionlib.SimpleActionClient(self.action, AssignTaskAction)

    def buildGoal(self) -> AssignTaskGoal:
        return AssignTaskGoal(goals=self.wish)

    def onFeedback(self, msg: AssignTaskFeedback) -> State:
        self.heard.append(msg.progress_message)
        return self.step(msg.progress_message)


class Server:
    """An action server with a name of its own.

    With `good` it succeeds, with `bad` it aborts, with `long` it works until it is cancelled.
    """

    def __init__(self) -> None:
        self.goals: list[str] = []
        self.cancelled = threading.Event()
        self.go_on = threading.Event()
        # In one process, connections to an earlier server of the same name may outlive it for a moment.
        self.name = f"/job_{next(_numbers)}"
        self._server = actionlib.SimpleActionServer(self.name, AssignTaskAction, self._work, auto_start=False)
        self._server.start()

    def fall_silent(self) -> None:
        """As when it hangs: no status any more."""
        self._server.action_server.publish_status = lambda: None

    def close(self) -> None:
        self.go_on.set()
        self.fall_silent()
        server = self._server.action_server
        for end in (server.status_pub, server.result_pub, server.feedback_pub, server.goal_sub, server.cancel_sub):
            end.unregister()

    def _work(self, goal: AssignTaskGoal) -> None:
        self.goals.append(goal.goals)
        for text in ("half", "nearly"):
            self._server.publish_feedback(AssignTaskFeedback(progress_message=text))
        if goal.goals == "long":
            while not self._server.is_preempt_requested() and not self.go_on.wait(0.01):
                pass
            self.cancelled.set()
            self._server.set_preempted(text="stopped")
        elif goal.goals == "bad":
            self._server.set_aborted(text="no way")
        else:
            self._server.set_succeeded(AssignTaskResult(progress_code=1), text="all done")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    server = Server()
    monkeypatch.setattr(job_action, "action", server.name)
    yield server
    server.close()


def loaded(cls: type, **attributes: Any) -> Any:
    skill = cls()
    for name, value in attributes.items():
        setattr(skill, name, value)
    assert skill.init(None)
    return skill


def run(skill: Any, until: Callable[[], bool] = lambda: False) -> State:
    """Ticks a started skill as an executor does, until it ends or the condition holds."""
    end = time.monotonic() + 15
    while skill.tick() is State.Running and not until():
        assert time.monotonic() < end, skill.progress_msg
        time.sleep(0.01)
    if skill.state is not State.Running:
        skill.onEnd()
    return skill.state


def hold_sending(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    """Makes `ActionClient.send_goal` return after the first answer, which a method of its `GoalManager` handles."""
    answered = threading.Event()
    send, answer = ActionClient.send_goal, getattr(GoalManager, method)

    def sending(self: ActionClient, *args: Any) -> Any:
        handle = send(self, *args)
        answered.wait(1.0)
        return handle

    def answering(self: GoalManager, *args: Any) -> None:
        answer(self, *args)
        answered.set()

    monkeypatch.setattr(ActionClient, "send_goal", sending)
    monkeypatch.setattr(GoalManager, method, answering)


@pytest.mark.parametrize("on_start", [True, False])
def test_successful_action_is_a_success_with_the_server_text(server: Server, on_start: bool) -> None:
    skill = loaded(job_action, build_client_onstart=on_start)
    for _ in range(2):
        skill.heard.clear()
        assert skill.start()
        assert run(skill) is State.Success
        assert skill.progress_msg == "all done"
        # Feedback and result have no order.
        assert set(skill.heard) <= {"half", "nearly"}
    assert server.goals == ["good", "good"]


def test_answers_that_arrive_while_the_goal_is_sent_are_heard(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    hold_sending(monkeypatch, "update_feedbacks")
    skill = loaded(job_action, wish="long")
    assert skill.start()
    run(skill, until=lambda: len(skill.heard) == 2)
    assert skill.heard == ["half", "nearly"]
    server.go_on.set()


def test_recovery_whose_result_arrives_while_the_goal_is_sent_ends(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    hold_sending(monkeypatch, "update_results")
    skill = loaded(recover_from_stop)
    skill.params.specify("Call", server.name)
    skill.params.specify("Type", "skiros2_msgs/AssignTaskAction")
    assert skill.start()
    states = rospy.Publisher(SAFETY_TOPIC, SafetyStatus, queue_size=1, latch=True)
    states.publish(SafetyStatus(state=Safety.RUNNING))
    assert run(skill) is State.Success, skill.progress_msg


def test_aborted_action_is_a_failure_with_its_status_as_code(server: Server) -> None:
    skill = loaded(job_action, wish="bad")
    skill.start()
    assert run(skill) is State.Failure
    assert (skill.progress_msg, skill.progress_code) == ("no way", -GoalStatus.ABORTED)


def test_a_preempted_action_is_cancelled(server: Server) -> None:
    skill = loaded(job_action, wish="long")
    skill.start()
    run(skill, until=lambda: bool(server.goals))
    assert skill.preempt() is State.Success
    assert skill.progress_msg == "Stopped"
    assert skill.onEnd()
    assert server.cancelled.wait(5)


def test_result_of_a_preempted_goal_does_not_reach_the_next_one(server: Server) -> None:
    skill = loaded(job_action, wish="long", build_client_onstart=False)
    skill.start()
    run(skill, until=lambda: bool(server.goals))
    skill.preempt()
    skill.onEnd()
    skill.wish = "good"
    skill.reset()
    skill.start()
    assert run(skill) is State.Success
    assert skill.progress_msg == "all done"


def test_skill_that_starts_again_keeps_its_connections(server: Server) -> None:
    def connection() -> Any:
        return server._server.action_server.goal_sub.impl.connections[0]

    skill = loaded(job_action)
    for again in (False, True):
        before = connection() if again else None
        skill.start()
        assert run(skill) is State.Success
        assert not again or connection() is before


def test_an_action_may_be_restarted_with_another_goal(server: Server) -> None:
    class restarting(job_action):
        def onDone(self, status: int, msg: Any) -> State:
            if status == GoalStatus.ABORTED:
                return self.restart(AssignTaskGoal(goals="good"), "once more")
            return super().onDone(status, msg)

    skill = loaded(restarting, wish="bad")
    skill.start()
    assert run(skill) is State.Success
    assert server.goals == ["bad", "good"]


def test_feedback_may_end_the_skill(server: Server) -> None:
    class impatient(job_action):
        def onFeedback(self, msg: AssignTaskFeedback) -> State:
            return self.fail("half is not enough", -7)

    skill = loaded(impatient, wish="long")
    skill.start()
    run(skill, until=lambda: bool(server.goals))
    skill._feedbackCb(AssignTaskFeedback(progress_message="half"))
    assert run(skill) is State.Failure
    assert (skill.progress_msg, skill.progress_code) == ("half is not enough", -7)


def test_on_start_of_a_library_may_send_the_goal(server: Server) -> None:
    class own_start(job_action):
        def onStart(self) -> bool:
            self.client = self.buildClient()
            assert self.client.wait_for_server(rospy.Duration.from_sec(5))
            self.client.send_goal(self.buildGoal(), done_cb=self._doneCb, feedback_cb=self._feedbackCb)
            return True

    skill = loaded(own_start)
    for _ in range(2):
        skill.start()
        assert run(skill) is State.Success


def test_unreported_end_of_a_goal_is_noticed(server: Server) -> None:
    class deaf(job_action):
        def _doneCb(self, status: int, msg: Any) -> None:
            """As when the end comes before send_goal has returned."""

    skill = loaded(deaf)
    skill.start()
    assert run(skill) is State.Success
    assert skill.progress_msg == "all done"


def test_missing_server_is_named_without_blocking_the_tree(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(action_client_primitive, "SERVER_TIMEOUT", 0.5)
    skill = loaded(job_action)
    began_at = time.monotonic()
    skill.start()
    assert skill.tick() is State.Running
    assert time.monotonic() - began_at < 0.2
    assert run(skill) is State.Failure
    assert (skill.progress_msg, skill.progress_code) == ("Action server /job is not available.", -101)


def test_silent_server_is_noticed(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(action_client_primitive, "SERVER_TIMEOUT", 1.0)
    skill = loaded(job_action, wish="long")
    skill.start()
    run(skill, until=lambda: bool(server.goals))
    server.fall_silent()
    assert run(skill) is State.Failure
    assert "has sent no status" in skill.progress_msg


def test_undelivered_goal_is_noticed(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(action_client_primitive, "SERVER_TIMEOUT", 1.0)
    skill = loaded(job_action)
    skill.start()
    skill.client.action_client.manager.register_send_goal_fn(lambda goal: None)
    assert run(skill) is State.Failure
    assert skill.progress_msg == f"The action server {server.name} did not accept the goal: it was lost"


@pytest.fixture
def slow_ticker() -> Iterator[Scheduler]:
    """Ticks a task once in the time of these tests, unless it is woken."""
    scheduler = Scheduler(rate=0.01)
    yield scheduler
    scheduler.stop()


def started(scheduler: Scheduler, skill: type) -> Task:
    """A task of a skill."""
    wmi = LocalWorldModel("tests")
    library = SkillLibrary(wmi)
    library.add(skill)
    task = scheduler.new_task(wmi, "tests")
    task.root(SkillWrapper("Job", "", library))
    scheduler.start(task.id)
    return task


def test_the_result_of_an_action_wakes_the_tree(server: Server, slow_ticker: Scheduler) -> None:
    class connected(job_action):
        build_client_onstart = False
        wish = "long"

        def buildClient(self) -> actionlib.SimpleActionClient:
            client = super().buildClient()
            assert client.wait_for_server(rospy.Duration.from_sec(5))
            return client

    task = started(slow_ticker, connected)
    wait_until(lambda: server.goals and task.root.children[0].progress_code > 0)
    server.go_on.set()
    assert task.ended.wait(15)
    assert task.root.children[0].progress_msg == "stopped"


class job_service(PrimitiveServiceClient):
    def createDescription(self) -> None:
        self.setDescription(Job(), "job_service")

    def buildClient(self) -> rospy.ServiceProxy:
        return rospy.ServiceProxy("/switch", SetBool)

    def buildRequest(self) -> SetBoolRequest:
        return SetBoolRequest(data=True)

    def onDone(self, response: SetBoolResponse) -> State:
        return self.success(response.message) if response.success else self.fail(response.message, 3)


@pytest.fixture
def switch() -> Iterator[dict[str, Any]]:
    """A service; `answer` is what it answers, or raises; it waits while `held` is cleared."""
    held = threading.Event()
    held.set()
    options: dict[str, Any] = {"answer": SetBoolResponse(True, "on"), "held": held}

    def handle(_: SetBoolRequest) -> SetBoolResponse:
        held.wait(5)
        if isinstance(options["answer"], Exception):
            raise options["answer"]
        return options["answer"]

    service = rospy.Service("/switch", SetBool, handle)
    yield options
    held.set()
    service.shutdown()


@pytest.mark.parametrize("on_start", [True, False])
def test_response_of_a_service_determines_the_state(switch: dict[str, Any], on_start: bool) -> None:
    skill = loaded(job_service, build_client_onstart=on_start)
    skill.start()
    assert run(skill) is State.Success
    assert skill.progress_msg == "on"
    switch["answer"] = SetBoolResponse(False, "stuck")
    skill.reset()
    skill.start()
    assert run(skill) is State.Failure
    assert (skill.progress_msg, skill.progress_code) == ("stuck", -3)


def test_response_of_a_service_wakes_the_tree(switch: dict[str, Any], slow_ticker: Scheduler) -> None:
    task = started(slow_ticker, job_service)
    assert task.ended.wait(15)
    assert task.root.children[0].progress_msg == "on"


def test_service_error_is_a_failure_with_its_text(switch: dict[str, Any]) -> None:
    switch["answer"] = rospy.ServiceException("fuse is gone")
    skill = loaded(job_service)
    skill.start()
    assert run(skill) is State.Failure
    assert "fuse is gone" in skill.progress_msg


def test_missing_service_is_a_failure() -> None:
    skill = loaded(job_service)
    skill.start()
    assert run(skill) is State.Failure
    assert "/switch" in skill.progress_msg


def test_slow_service_times_out_without_blocking_the_tree(switch: dict[str, Any]) -> None:
    switch["held"].clear()
    skill = loaded(job_service, call_timeout_sec=0.3)
    began_at = time.monotonic()
    skill.start()
    assert skill.tick() is State.Running
    assert time.monotonic() - began_at < 0.2
    assert run(skill) is State.Failure
    assert skill.progress_msg == "No answer from /switch within 0.3 s"


def test_response_to_an_abandoned_call_is_discarded(switch: dict[str, Any]) -> None:
    switch["held"].clear()
    skill = loaded(job_service)
    skill.start()
    skill.tick()
    assert skill.preempt() is State.Failure
    switch["answer"] = SetBoolResponse(True, "late")
    switch["held"].set()
    wait_until(lambda: not [t for t in threading.enumerate() if t.name == "service call"])
    switch["answer"] = SetBoolResponse(True, "new")
    skill.reset()
    skill.start()
    assert run(skill) is State.Success
    assert skill.progress_msg == "new"
