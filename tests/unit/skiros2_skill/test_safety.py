"""Stops of a robot: the state machine, the reading of sources, and what they do with tasks."""

from __future__ import annotations

import math
import queue
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from skiros2_common.core.abstract_skill import SkillDescription, State
from skiros2_common.core.errors import ConfigurationError, RobotStopped
from skiros2_common.core.explanation import STOP, worst_kind
from skiros2_common.core.failure_kind import FailureKind
from skiros2_runs.core.states import TaskState
from skiros2_skill.core.runtime.history import History, record_of
from skiros2_skill.core.runtime.request import SkillRequest, TaskRefused, TaskStarter
from skiros2_skill.core.runtime.safety import MAX_REASON, Safety, SafetyState, SourceRules
from skiros2_skill.core.runtime.safety_guard import Policy, SafetyGuard
from skiros2_skill.core.runtime.safety_sources import DIAGNOSTICS, Recovery, SafetySettings, read_settings
from skiros2_skill.core.runtime.scheduler import Scheduler
from unit.skiros2_skill.skills import Work, describe, primitive

BUTTON = SourceRules("/e_stop", Safety.EMERGENCY_STOP, clear_delay=0.5)
ARM = SourceRules("/arm", Safety.PROTECTIVE_STOP, clear_delay=0.0)
DRIVER = SourceRules("/driver", Safety.FAULT, clear_delay=0.0)


# -- the state machine ------------------------------------------------------------------------------------------------


def test_robot_without_stops_is_running() -> None:
    state = SafetyState([BUTTON], 0.0)
    assert (state.state, state.reason, state.deadline()) == (Safety.RUNNING, "", math.inf)
    assert not state.report("/e_stop", "", 1.0)


def test_emergency_stop_wins_and_each_source_clears_its_own_stop() -> None:
    state = SafetyState([BUTTON, ARM, DRIVER], 0.0)
    assert state.report("/arm", "collision", 1.0)
    assert state.report("/e_stop", "pressed", 2.0)
    assert state.report("/driver", "no power", 3.0)
    assert [stop.kind for stop in state.stops] == [Safety.EMERGENCY_STOP, Safety.FAULT, Safety.PROTECTIVE_STOP]
    assert state.reason == "emergency stop by /e_stop: pressed"
    assert state.report("/arm", "", 4.0)
    assert state.report("/driver", "", 4.0)
    assert state.state is Safety.EMERGENCY_STOP
    state.report("/e_stop", "", 5.0)
    assert state.update(5.5)
    assert state.state is Safety.RUNNING


def test_flapping_signal_is_one_stop() -> None:
    state = SafetyState([BUTTON], 0.0)
    assert state.report("/e_stop", "pressed", 0.0)
    since = state.stops[0].since
    changes = [state.report("/e_stop", "pressed" if n % 2 else "", 0.1 * n) for n in range(1, 100)]
    assert not any(changes)
    assert state.stops[0].since == since
    state.report("/e_stop", "", 10.0)
    assert state.deadline() == 10.5
    assert not state.update(10.4)
    assert state.update(10.5)


def test_new_reason_of_a_stop_keeps_its_time() -> None:
    state = SafetyState([ARM], 0.0)
    state.report("/arm", "collision", 1.0)
    since = state.stops[0].since
    assert not state.report("/arm", "collision", 2.0)
    assert state.report("/arm", "joint limit", 3.0)
    assert (state.stops[0].reason, state.stops[0].since) == ("joint limit", since)


def test_silent_required_source_is_a_stop_until_it_reports_again() -> None:
    state = SafetyState([SourceRules("/e_stop", Safety.EMERGENCY_STOP, timeout=1.0, clear_delay=0.0)], 0.0)
    assert state.reason == "emergency stop by /e_stop: no message yet, and the source is required"
    assert state.report("/e_stop", "", 5.0)
    assert state.state is Safety.RUNNING
    assert state.deadline() == 6.0
    assert not state.update(5.9)
    assert state.update(6.0)
    assert state.reason == "emergency stop by /e_stop: no message for 1 s, and the source is required"
    assert state.report("/e_stop", "", 7.0)
    assert state.state is Safety.RUNNING


def test_silence_during_the_clear_delay_keeps_the_stop() -> None:
    state = SafetyState([SourceRules("/e_stop", Safety.EMERGENCY_STOP, timeout=1.0, clear_delay=2.0)], 0.0)
    state.report("/e_stop", "", 5.0)
    assert state.deadline() == 6.0
    state.update(6.0)
    state.update(7.5)
    assert "no message for 1 s" in state.reason


def test_silent_source_that_is_not_required_keeps_its_last_report() -> None:
    state = SafetyState([BUTTON, ARM], 0.0)
    state.report("/arm", "collision", 0.0)
    assert not state.update(1e6)
    assert state.reason == "protective stop by /arm: collision"


def test_reason_has_a_maximum_length() -> None:
    state = SafetyState([ARM], 0.0)
    state.report("/arm", "x" * 10_000, 0.0)
    assert len(state.stops[0].reason) == MAX_REASON + 1


# -- the configuration ------------------------------------------------------------------------------------------------


class Bool:
    __slots__ = ("data",)

    def __init__(self, data: Any = False) -> None:
        self.data = data


class Errors:
    __slots__ = ("joint_limit", "reflex")

    def __init__(self, joint_limit: Any = False, reflex: Any = False) -> None:
        self.joint_limit, self.reflex = joint_limit, reflex


class ArmState:
    __slots__ = ("errors", "force", "mode")

    def __init__(self, mode: Any = 1, errors: Any = None, force: Any = 0.0) -> None:
        self.mode, self.errors, self.force = mode, errors or Errors(), force


class Diagnostics:
    __slots__ = ("status",)

    def __init__(self, *status: tuple[str, Any, str]) -> None:
        self.status = [SimpleNamespace(name=name, level=level, message=text) for name, level, text in status]


TYPES = {
    "std_msgs/Bool": Bool,
    "arm_msgs/ArmState": ArmState,
    DIAGNOSTICS: Diagnostics,
    "std_srvs/Trigger": Bool,
    "arm_msgs/RecoverAction": Bool,
}


def settings(*sources: Any, recovery: Any = None, **policies: Any) -> SafetySettings:
    return read_settings([*sources], policies, recovery or {}, lambda name, kind: TYPES.get(name), lambda topic: topic)


def source(**entry: Any) -> Any:
    return settings(entry).sources[0]


def test_defaults_of_a_bool_and_of_diagnostics() -> None:
    found = settings({"topic": "/e_stop"}, {"topic": "/diagnostics", "type": DIAGNOSTICS})
    button, diagnostics = found.sources
    assert button.rules == SourceRules("/e_stop", Safety.EMERGENCY_STOP, None, 0.5)
    assert diagnostics.rules.kind is Safety.FAULT
    assert found.policies == {"protective_stop": "pause", "fault": "fail", "emergency_stop": "fail"}
    assert found.recovery == Recovery("", "std_srvs/Trigger")
    assert settings(protective_stop="fail").policies[Safety.PROTECTIVE_STOP] is Policy.FAIL


def test_all_problems_of_a_configuration_are_one_message() -> None:
    arm = {"topic": "/arm", "type": "arm_msgs/ArmState", "kind": "protective_stop"}
    with pytest.raises(ConfigurationError) as problem:
        settings(
            "/e_stop",
            {"topik": "/e_stop"},
            {"topic": "/e_stop", "timeout": 2.0},
            {"topic": "/a", "required": "yes", "clear_delay": -1, "kind": "stop"},
            {**arm, "field": "mod", "stop_values": [2]},
            {**arm, "field": "mode"},
            {**arm, "type": "arm_msgs/Arm", "field": "mode", "ok_values": [1]},
            {"topic": "/diagnostics", "type": DIAGNOSTICS, "field": "status", "names": [3], "level": "stale"},
            {"topic": "/b"},
            {"topic": "/b"},
            {"topic": "/c", "required": True, "timeout": 0},
            recovery={"service": "/recover"},
            fault="ignore",
        )
    text = str(problem.value)
    for part in (
        "safety_sources[0]: expected a dictionary with the key 'topic', got '/e_stop'",
        "safety_sources[1]: unknown keys topik",
        "safety_sources[2]: 'timeout' has an effect only with 'required: true'",
        "safety_sources[3]: 'required' is 'yes', expected true or false",
        "safety_sources[3]: 'clear_delay' is -1, expected a number of seconds from 0",
        "safety_sources[3]: 'kind' is 'stop', expected one of: protective_stop, fault, emergency_stop",
        "safety_sources[4]: 'field' is 'mod': ArmState has no field 'mod'; there are: errors, force, mode",
        "safety_sources[5]: expected either 'stop_values' or 'ok_values'",
        "safety_sources[6]: there is no message type 'arm_msgs/Arm'",
        "safety_sources[7]: 'field' is not for diagnostics",
        "safety_sources[7]: 'names' is to be a list of patterns",
        "safety_sources[7]: 'level' is 'stale', expected one of: warn, error",
        "safety_sources[9]: the name '/b' is used twice",
        "safety_sources[10]: 'timeout' is 0",
        "on_fault is 'ignore', expected pause or fail",
        "recovery: expected a dictionary with 'call' and 'type'",
    ):
        assert part in text
    with pytest.raises(ConfigurationError, match="safety_sources is 7, expected a list of dictionaries"):
        read_settings(7, {}, {}, lambda name, kind: None, str)
    with pytest.raises(ConfigurationError, match="there is no service or action type 'a/B'"):
        settings(recovery={"call": "/recover", "type": "a/B"})
    with pytest.raises(ConfigurationError, match="topic /e_stop has type std_msgs/Bool in another source"):
        settings({"topic": "/e_stop"}, {"topic": "/e_stop", "type": DIAGNOSTICS, "name": "d"})


def test_field_with_stop_values() -> None:
    arm = source(topic="/arm", type="arm_msgs/ArmState", field="mode", kind="protective_stop", stop_values=[4, 5])
    assert arm.read(ArmState(1)) == ""
    assert arm.read(ArmState(4)) == "mode is 4"


def test_field_with_ok_values() -> None:
    arm = source(topic="/arm", type="arm_msgs/ArmState", field="mode", kind="fault", ok_values=[1, 2])
    assert arm.read(ArmState(2)) == ""
    assert arm.read(ArmState(0)) == "mode is 0"


def test_field_with_fields_names_those_that_are_set() -> None:
    arm = source(topic="/arm", type="arm_msgs/ArmState", field="errors", kind="fault", stop_values=[True])
    assert arm.read(ArmState(errors=Errors())) == ""
    assert arm.read(ArmState(errors=Errors(reflex=True))) == "errors.reflex is True"


@pytest.mark.parametrize("message", [object(), None, ArmState(errors=7), SimpleNamespace(status=3)])
def test_unreadable_message_is_a_stop(message: Any) -> None:
    for one in (
        source(topic="/arm", type="arm_msgs/ArmState", field="errors.reflex", kind="fault", stop_values=[True]),
        source(topic="/diagnostics", type=DIAGNOSTICS),
    ):
        assert one.read(message).startswith("unreadable message: ")


@pytest.mark.parametrize("error", [KeyError("mode"), ZeroDivisionError(), RuntimeError("?"), SystemExit(1)])
def test_message_that_raises_anything_is_a_stop(error: BaseException) -> None:
    class Broken:
        __slots__ = ("errors",)

        def __getattr__(self, name: str) -> Any:
            raise error

    arm = source(topic="/arm", type="arm_msgs/ArmState", field="errors", kind="fault", stop_values=[True])
    assert arm.read(Broken()).startswith(f"unreadable message: {type(error).__name__}")


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_number_that_is_not_finite_is_a_stop(value: float) -> None:
    arm = source(topic="/arm", type="arm_msgs/ArmState", field="force", kind="fault", stop_values=[1.0])
    assert arm.read(ArmState(force=0.5)) == ""
    assert arm.read(ArmState(force=value)) == f"force is {value}"


def test_diagnostics_remember_failing_parts_by_name() -> None:
    found = source(topic="/diagnostics", type=DIAGNOSTICS, names=["arm: *", "gripper"])
    assert found.read(Diagnostics(("arm: motor", 1, "warm"), ("camera", 2, "gone"))) == ""
    assert found.read(Diagnostics(("arm: motor", 2, "too hot\nby far"))) == "arm: motor: too hot (error)"
    assert (
        found.read(
            Diagnostics(("gripper", 3, "")),
        )
        == "arm: motor: too hot (error); gripper: (stale)"
    )
    assert found.read(Diagnostics(("arm: motor", 0, "ok"))) == "gripper: (stale)"
    assert found.read(Diagnostics(("gripper", 0, ""))) == ""
    assert found.read(Diagnostics()) == ""


def test_diagnostics_with_an_unknown_level_are_a_stop() -> None:
    found = source(topic="/diagnostics", type=DIAGNOSTICS, level="warn")
    assert found.read(Diagnostics(("arm", 1, "warm"))) == "arm: warm (warn)"
    assert found.read(Diagnostics(("arm", 9, "?"))) == "arm: ? (unknown level 9)"
    assert found.read(Diagnostics(("arm", -1, "?"))) == "arm: ? (unknown level -1)"
    assert found.read(Diagnostics(*((f"part {n}", 2, "bad") for n in range(100)))).endswith("; 98 more")


# -- tasks ------------------------------------------------------------------------------------------------------------


class Reset(SkillDescription):
    def createDescription(self) -> None:
        self.allowed_when_stopped = True


class Robot:
    """A robot with an arm, an emergency button and a driver that report stops."""

    def __init__(self, bench: Any, **policies: str) -> None:
        self.ended: list[Any] = []
        bench.load(primitive(Work, "work", execute=lambda self: self.step("moving")))
        bench.load(primitive(Reset, "reset", execute=lambda self: self.step("resetting")))
        self.reported: queue.Queue[tuple[int, State, str]] = queue.Queue()  # paused tasks
        self.scheduler = Scheduler(rate=200, on_progress=self._report)
        self.history = History()
        self.starter = TaskStarter(bench.library, bench.wmi, self.scheduler, self.history, lambda: bench.robot)
        self.published: list[list[str]] = []
        self.cleared = threading.Event()
        sources = [SourceRules("/e_stop", Safety.EMERGENCY_STOP, clear_delay=0.01), ARM, DRIVER]
        self.guard = SafetyGuard(
            sources, {Safety(k): Policy(p) for k, p in policies.items()}, self.scheduler, self._publish
        )

    def _report(self, task: Any) -> None:
        if task.paused and not task.ended.is_set():
            self.reported.put((task.id, task.state, task.root.progress_msg))

    def _publish(self, stops: Any) -> None:
        self.published.append([*map(str, stops)])
        if not stops:
            self.cleared.set()

    def start(self, skill: str = "Work") -> Any:
        task = self.starter.make("tests", [SkillRequest(skill, "", {})])
        self.scheduler.start(task.id)
        return task


@pytest.fixture
def robot(bench: Any) -> Any:
    robot = Robot(bench)
    yield robot
    robot.guard.close()
    robot.scheduler.stop()


def test_protective_stop_pauses_tasks_until_they_are_resumed(robot: Robot) -> None:
    task = robot.start()
    robot.guard.report("/arm", "collision")
    assert (task.status, task.root.progress_msg) == (TaskState.PAUSED, "paused: protective stop by /arm: collision")
    assert str(record_of(task)) == f"task {task.id} by tests is paused: protective stop by /arm: collision"
    with pytest.raises(RobotStopped, match="protective stop by /arm: collision"):
        robot.scheduler.start(task.id)
    with pytest.raises(RobotStopped):
        robot.scheduler.start(task.id, ticks=1)
    robot.guard.report("/arm", "")
    assert task.paused
    assert task.root.progress_msg == ("paused: protective stop by /arm: collision; it is over, resume or stop the task")
    robot.scheduler.start(task.id)
    assert task.status is TaskState.RUNNING
    assert robot.published == [[], ["protective stop by /arm: collision"], []]


def test_task_that_is_paused_before_its_first_tick_reports_the_stop(robot: Robot, bench: Any) -> None:
    entered, released = threading.Event(), threading.Event()

    def block(self: Any) -> State:
        entered.set()
        released.wait(5)
        return self.success("done")

    bench.load(primitive(describe("Block"), "block", execute=block))
    robot.start("Block")
    assert entered.wait(5)  # the other tasks are not ticked for 0.1 s
    task = robot.start()
    robot.guard.report("/arm", "collision")
    released.set()
    assert robot.reported.get(timeout=5) == (task.id, State.Idle, "paused: protective stop by /arm: collision")


def test_emergency_stop_fails_running_and_paused_tasks_with_the_reason(robot: Robot) -> None:
    tasks = [robot.start(), robot.start()]
    robot.scheduler.pause(tasks[1].id)
    robot.guard.report("/e_stop", "pressed")
    for task in tasks:
        assert task.ended.wait(5)
        assert (task.state, task.status) == (State.Failure, TaskState.FAILED)
        record = record_of(task)
        assert (record.code, record.message, record.preempted) == (-5, "emergency stop by /e_stop: pressed", False)
        (why,) = [w for w in record.explanations if w.stage == STOP]
        assert why.failure_kind is FailureKind.SAFETY
        assert (why.code, why.message) == (-5, "emergency stop by /e_stop: pressed")
        assert "emergency stop by /e_stop: pressed" in str(record)


def test_emergency_stop_fails_tasks_that_a_protective_stop_has_paused(robot: Robot) -> None:
    task = robot.start()
    robot.guard.report("/arm", "collision")
    robot.guard.report("/e_stop", "pressed")
    assert task.ended.wait(5)
    assert record_of(task).message == "emergency stop by /e_stop: pressed"


def test_policy_of_a_kind_can_be_chosen(bench: Any) -> None:
    robot = Robot(bench, fault="pause", protective_stop="fail")
    try:
        task = robot.start()
        robot.guard.report("/driver", "no power")
        assert task.status is TaskState.PAUSED
        robot.guard.report("/driver", "")
        robot.scheduler.start(task.id)
        robot.guard.report("/arm", "collision")
        assert task.ended.wait(5)
        assert record_of(task).message == "protective stop by /arm: collision"
        assert worst_kind(record_of(task).explanations) is FailureKind.SAFETY
    finally:
        robot.guard.close()
        robot.scheduler.stop()


def test_start_is_refused_with_reason_and_code_also_in_preview(robot: Robot) -> None:
    robot.guard.report("/driver", "no power")
    with pytest.raises(TaskRefused, match="fault by /driver: no power") as refused:
        robot.start()
    assert refused.value.record.code == -5
    (why,) = robot.history.get(-1).explanations
    assert (why.stage, why.type, why.code, why.failure_kind) == (STOP, "Work", -5, FailureKind.SAFETY)
    refusal = robot.starter.preview([SkillRequest("Work", "", {})]).refusal
    assert refusal is not None
    assert (refusal.stage, refusal.code, refusal.message) == (STOP, -5, "fault by /driver: no power")
    robot.guard.report("/driver", "")
    assert robot.starter.preview([SkillRequest("Work", "", {})]).refusal is None
    robot.start()


def test_skill_that_is_allowed_starts_and_runs_on_while_stopped(robot: Robot) -> None:
    robot.guard.report("/arm", "collision")
    assert robot.starter.preview([SkillRequest("Reset", "", {})]).refusal is None
    task = robot.start("Reset")
    robot.guard.report("/e_stop", "pressed")
    robot.guard.report("/driver", "no power")
    assert task.status is TaskState.RUNNING
    with pytest.raises(TaskRefused):
        robot.starter.make("tests", [SkillRequest("Reset", "", {}), SkillRequest("Work", "", {})])


def test_stop_between_request_and_start_withdraws_the_task(robot: Robot) -> None:
    task = robot.starter.make("tests", [SkillRequest("Work", "", {})])
    robot.guard.report("/e_stop", "pressed")
    with pytest.raises(RobotStopped) as stopped:
        robot.scheduler.start(task.id)
    record = robot.starter.withdraw(task, stopped.value).record
    assert (record.task_id, record.code, record.message) == (-1, -5, "emergency stop by /e_stop: pressed")
    assert worst_kind(record.explanations) is FailureKind.SAFETY
    assert robot.scheduler.tasks() == []
    assert robot.history.get(-1) is record


def test_task_that_cannot_be_filled_is_not_left_behind(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def raises(*_: object) -> None:
        raise RuntimeError("no memory")

    monkeypatch.setattr("skiros2_skill.core.runtime.request._fill", raises)
    for _ in range(3):
        with pytest.raises(TaskRefused, match="no memory"):
            robot.starter.make("tests", [SkillRequest("Work", "", {})])
    assert robot.scheduler.tasks() == []


def test_flapping_fails_tasks_once_and_is_published_once(robot: Robot) -> None:
    task = robot.start()
    for n in range(1000):
        robot.guard.report("/e_stop", "" if n % 2 else "pressed")
    assert task.ended.wait(5)
    robot.guard.report("/e_stop", "pressed")
    before = len(robot.published)
    robot.cleared.clear()
    robot.guard.report("/e_stop", "")
    assert robot.cleared.wait(5), "no thread has ended the stop"
    assert robot.published[before:] == [[]]
    assert len(robot.published) < 20
    assert robot.guard.stops == ()


def test_guard_stops_when_a_required_source_falls_silent(bench: Any) -> None:
    scheduler = Scheduler(rate=200)
    stopped = threading.Event()
    rules = SourceRules("/e_stop", Safety.EMERGENCY_STOP, timeout=0.05, clear_delay=0.0)
    guard = SafetyGuard([rules], {}, scheduler, lambda stops: stopped.set() if stops else stopped.clear())
    try:
        assert "no message yet" in scheduler.stop_reason()
        guard.report("/e_stop", "")
        assert scheduler.stop_reason() == "" or stopped.is_set()
        assert stopped.wait(5)
        assert "no message for 0.05 s" in scheduler.stop_reason()
    finally:
        guard.close()
        scheduler.stop()
