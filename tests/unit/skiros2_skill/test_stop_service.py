"""Stops, pauses and resumptions by a deadline."""

import math

import pytest

from skiros2_common.core.abstract_skill import State
from skiros2_msgs.srv import SkillStopRequest
from skiros2_skill.core.runtime.scheduler import Scheduler
from skiros2_skill.ros.stop_service import ALL, StopService
from unit.skiros2_skill.skills import Work, primitive, running_for

PREEMPT, PAUSE, RESUME = SkillStopRequest.PREEMPT, SkillStopRequest.PAUSE, SkillStopRequest.RESUME


class Robot:
    """Two tasks that run, and the service."""

    def __init__(self, bench):
        bench.load(primitive(Work, "work", execute=running_for(10**9)))
        self.now = 100.0
        self.catch_up_time = 0.0
        self.scheduler = Scheduler()
        self.service = StopService(self.scheduler, self.catch_up, lambda: self.now)
        self.tasks = [self.start(bench) for _ in range(2)]

    def start(self, bench):
        task = self.scheduler.new_task(bench.wmi, "test")
        task.root(bench.node("work"))
        self.scheduler.start(task.id)
        return task

    def catch_up(self):
        self.now += self.catch_up_time

    def send(self, action, task_id=ALL, deadline=101.0):
        return self.service.handle(SkillStopRequest("test", action, task_id, deadline))


@pytest.fixture
def robot(bench):
    robot = Robot(bench)
    yield robot
    robot.scheduler.stop()


def test_all_tasks_are_paused_resumed_and_stopped(robot):
    ids = [task.id for task in robot.tasks]
    assert list(robot.send(PAUSE).tasks) == ids
    assert all(task.paused for task in robot.tasks)
    assert list(robot.send(RESUME).tasks) == ids
    assert not any(task.paused for task in robot.tasks)
    assert list(robot.send(PREEMPT).tasks) == ids
    assert all(task.ended.wait(10) for task in robot.tasks)
    assert robot.tasks[0].state is State.Failure


def test_one_task_is_stopped(robot):
    answer = robot.send(PREEMPT, robot.tasks[0].id)
    assert (answer.ok, list(answer.tasks)) == (True, [robot.tasks[0].id])
    assert robot.tasks[0].ended.wait(10)
    assert not robot.tasks[1].ended.is_set()


@pytest.mark.parametrize("deadline", [99.9, 0.0, -math.inf, math.nan])
@pytest.mark.parametrize("action", [PREEMPT, PAUSE, RESUME])
def test_late_command_changes_nothing(robot, action, deadline):
    was_paused = action == RESUME
    if was_paused:
        robot.send(PAUSE)
    answer = robot.send(action, deadline=deadline)
    assert (answer.ok, answer.code) == (False, "timed_out")
    assert [task.paused for task in robot.tasks] == [was_paused] * 2
    assert all(task.preempted_at is None for task in robot.tasks)


def test_nothing_is_resumed_when_the_world_model_answers_after_the_deadline(robot):
    robot.send(PAUSE)
    robot.catch_up_time = 2.0
    assert robot.send(RESUME).code == "timed_out"
    assert all(task.paused for task in robot.tasks)


@pytest.mark.parametrize(("action", "task_id"), [("hop", ALL), (PREEMPT, 99), (PAUSE, -2), (RESUME, 0)])
def test_wrong_command_is_refused_with_a_code(robot, action, task_id):
    answer = robot.send(action, task_id)
    assert not answer.ok
    assert answer.code == ("refused" if action == RESUME else "unknown_name")  # task 0 runs already
    assert answer.text.startswith(f"{action} by test refused: ")


def test_clock_is_read_without_a_deadline(robot):
    answer = robot.send("", deadline=0.0)
    assert (answer.ok, answer.clock, list(answer.tasks)) == (True, 100.0, [])
