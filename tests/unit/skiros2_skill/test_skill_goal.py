"""Goals that the manager does not accept in time."""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest
import rospy
from actionlib import CommState

from skiros2_common.core.errors import TimedOut
from skiros2_common.ros import connections
from skiros2_skill.client import skill_goal


class Client:
    """An action client with a live server; `accept` makes the server accept a goal."""

    ns = "/robot/execute"
    pub_goal = pub_cancel = SimpleNamespace(impl=SimpleNamespace(set_queue_size=lambda size: None))
    feedback_sub = SimpleNamespace(resolved_name="/robot/execute/feedback", data_class=None)

    def __init__(self):
        self.handles = []
        self.manager = SimpleNamespace()
        self.delay = 0.0

    @property
    def last_status_msg(self):
        """A new message each time: the server is alive."""
        stamp = rospy.Time(connections.time.time() - self.delay)
        return SimpleNamespace(header=SimpleNamespace(stamp=stamp))

    def send_goal(self, goal, on_transition):
        handle = SimpleNamespace(state=CommState.WAITING_FOR_GOAL_ACK, on_transition=on_transition)
        number = SimpleNamespace(goal_id=SimpleNamespace(id=f"goal {len(self.handles)}"))
        handle.comm_state_machine = SimpleNamespace(action_goal=number)
        handle.get_comm_state = lambda: handle.state
        self.handles.append(handle)
        return handle

    def accept(self, number):
        self.handles[number].state = CommState.ACTIVE
        self.handles[number].on_transition(self.handles[number])


@pytest.fixture
def clock(monkeypatch):
    clock = SimpleNamespace(now=100.0, wall=1e9, sleep=None)
    clock.monotonic = lambda: clock.now
    clock.time = lambda: clock.wall + clock.now
    monkeypatch.setattr(skill_goal, "time", clock)
    monkeypatch.setattr(connections, "time", clock)
    return clock


@pytest.fixture
def client():
    return Client()


@pytest.fixture
def runs(client, clock):
    """Three goals, sent one after the other."""
    last_accepted = skill_goal._LastAccepted()
    runs = []
    for _ in range(3):
        runs.append(skill_goal.SkillGoal(client, None, None, last_accepted))
        clock.now += 0.01
    return runs


def test_goal_that_is_not_accepted_times_out(runs, clock):
    clock.now += skill_goal.ACCEPT_TIMEOUT + 0.1
    with pytest.raises(TimedOut, match="/robot/execute did not accept the goal"):
        runs[0].wait(0.0)


def test_goal_waits_for_a_busy_manager_that_publishes_its_status(runs, clock):
    clock.now += 2 * skill_goal.SILENCE
    assert not runs[0].wait(0.0)


def test_goal_waits_while_status_messages_arrive_late(runs, client, clock):
    client.delay = skill_goal.ACCEPT_TIMEOUT
    clock.now += skill_goal.ACCEPT_TIMEOUT + 0.1
    assert not runs[0].wait(0.0)


@pytest.mark.parametrize("days", [-1, 1])
@pytest.mark.parametrize("delay", [0.0, skill_goal.ACCEPT_TIMEOUT])
def test_wall_clock_that_is_set_changes_nothing(runs, client, clock, days, delay):
    client.delay = delay
    clock.wall += days * 86_400.0
    clock.now += skill_goal.ACCEPT_TIMEOUT + 0.1
    with nullcontext() if delay else pytest.raises(TimedOut, match="did not accept"):
        assert not runs[0].wait(0.0)


def test_goal_waits_while_earlier_goals_are_accepted(runs, client, clock):
    for number in range(2):
        clock.now += skill_goal.ACCEPT_TIMEOUT - 1.0
        client.accept(number)
        assert not runs[2].wait(0.0)
    clock.now += skill_goal.ACCEPT_TIMEOUT + 0.1
    with pytest.raises(TimedOut, match="did not accept"):
        runs[2].wait(0.0)


def test_goal_that_was_passed_over_times_out(runs, client, clock):
    clock.now += skill_goal.ACCEPT_TIMEOUT + 0.1
    client.accept(2)
    assert not runs[2].wait(0.0)
    with pytest.raises(TimedOut, match="did not accept"):
        runs[1].wait(0.0)


def test_feedback_after_result_is_delivered(client, monkeypatch):
    callbacks = {}
    monkeypatch.setattr(skill_goal.actionlib, "ActionClient", lambda name, kind: client)
    monkeypatch.setattr(skill_goal.rospy, "Subscriber", lambda topic, kind, call: callbacks.setdefault(topic, call))
    monkeypatch.setattr(skill_goal.ServerWatch, "is_connected", lambda self: True)
    received = []
    run = skill_goal.SkillRunner("/robot").run("me", [], received.append)
    handle = client.handles[0]
    handle.state, handle.get_result = CommState.DONE, lambda: SimpleNamespace(task_id=7)
    handle.on_transition(handle)
    assert run.done
    for goal in ("goal 0", "goal of somebody else"):
        status = SimpleNamespace(goal_id=SimpleNamespace(id=goal))
        feedback = SimpleNamespace(task_id=7, of=goal)
        callbacks["/robot/execute/feedback"](SimpleNamespace(status=status, feedback=feedback))
    assert [feedback.of for feedback in received] == ["goal 0"]
