"""The task manager alone: it gets the recorded goals in the recorded scenes, and has to plan as well as then."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import actionlib
import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.kinds import Settings
from skiros2_bags.testing.lab import Lab
from skiros2_bags.testing.live_replay import SceneFollower
from skiros2_bags.testing.past_world import requests_of, scene_before, world_of
from skiros2_bags.testing.recording import Acted, Recording
from skiros2_bags.testing.system_nodes import start_task_manager, start_world_model
from skiros2_common.core.errors import TimedOut, WrongValue
from skiros2_common.core.names import same_node
from skiros2_common.core.world_element import Element
from skiros2_msgs import msg as msgs
from skiros2_skill.ros.utils import deserialize_skill
from skiros2_task.core.planner import Limits
from skiros2_task.core.planning import TaskPlanner
from skiros2_task.core.semantics import validate
from skiros2_task.core.task import PlanningTask, PlanStep
from skiros2_task.ros.task_manager_interface import FAILED, NOTHING_TO_DO, PLAN
from skiros2_world_model.core.local_world_model import LocalWorldModel

PLAN_ACTION, ACHIEVE_ACTION = "/tm/task_plan", "/tm/achieve"

#: How long the task manager may take to come up, and to answer (s).
PATIENCE = 60.0


@dataclass(frozen=True)
class Call:
    """A step of a plan: the skill's label, the manager of the robot that does it, and the elements' ids by key."""

    label: str
    manager: str
    arguments: frozenset[tuple[str, str]]

    def __str__(self) -> str:
        values = ", ".join(f"{key}={value}" for key, value in sorted(self.arguments))
        return f"{self.label} by {self.manager}: {values}"


@dataclass(frozen=True)
class Answer:
    """What came of a goal: `PLAN`, `NOTHING_TO_DO` or `FAILED`, and the steps or the reason."""

    code: int
    calls: tuple[Call, ...] = ()
    message: str = ""

    def __str__(self) -> str:
        if self.code == PLAN:
            return "\n".join(f"{number}. {call}" for number, call in enumerate(self.calls, 1))
        return "nothing to do" if self.code == NOTHING_TO_DO else f"no plan: {self.message}"


def replay_task_manager(recording: Recording, settings: Settings, lab: Lab) -> Divergence | None:
    """Has all recorded goals planned again. None: each plan is the same, or one that works and is no longer."""
    goals = [(goal, answer) for goal in _goals(recording) if (answer := _recorded(recording, goal)) is not None]
    if not goals:
        raise BagError(f"{recording.path}: no goals with plans; expected some on {ACHIEVE_ACTION} or {PLAN_ACTION}")
    begin = goals[0][0].order
    start_world_model(lab, scene_before(recording, begin), settings.workspace, [])
    start_task_manager(lab, recording)
    client = actionlib.SimpleActionClient(PLAN_ACTION, msgs.AssignTaskAction)
    if not client.wait_for_server(rospy.Duration.from_sec(PATIENCE)):
        raise TimedOut(f"no task manager on {PLAN_ACTION} within {PATIENCE:g} s")
    follower = SceneFollower()
    waiting = requests_of([e for e in recording.changes if e.order > begin])
    for goal, expected in goals:
        while waiting and waiting[0][0].order < goal.order:
            follower.apply(waiting.pop(0))
        author = goal.content.author if goal.action == PLAN_ACTION else ""
        client.send_goal(msgs.AssignTaskGoal(author, goal.content.goals))
        if not client.wait_for_result(rospy.Duration.from_sec(PATIENCE)):
            raise TimedOut(f"goal {goal.content.goals}: no answer of the task manager within {PATIENCE:g} s")
        got = _answer(client.get_result())
        reason = _worse(expected, got, recording, goal, settings)
        if reason:
            where = f"{goal.time - recording.events[0].time:.3f} s, goal {goal.content.goals}"
            return Divergence(where, f"the plan {reason}", str(expected), str(got))
    return None


def _goals(recording: Recording) -> list[Acted]:
    return [e for e in recording.acted if e.part == "goal" and e.action in (PLAN_ACTION, ACHIEVE_ACTION)]


def _recorded(recording: Recording, goal: Acted) -> Answer | None:
    """What came of a goal; None when that is not in the bag."""
    result = recording.result(goal)
    if goal.action == PLAN_ACTION:
        return _answer(result.content) if result is not None else None
    for event in recording.acted:
        if event.part == "feedback" and event.goal_id == goal.goal_id and event.content.plan not in ("", "[]"):
            return Answer(PLAN, tuple(_planned(step) for step in json.loads(event.content.plan)))
    if result is None:
        return None
    code = NOTHING_TO_DO if result.content.state == msgs.AchieveResult.NOTHING_TO_DO else FAILED
    return Answer(code, message=result.content.message)


def _planned(step: dict[str, Any]) -> Call:
    return Call(step["label"], step["robot"], frozenset(step["arguments"].items()))


def _answer(result: Any) -> Answer:
    """The task manager's answer.

    :raises WrongValue: the plan cannot be read.
    """
    if result.progress_code != PLAN:
        return Answer(result.progress_code, message=result.progress_message)
    return Answer(PLAN, tuple(_held(step) for step in deserialize_skill(result.progress_message).children))


def _held(step: Any) -> Call:
    arguments = {
        (key, value.id or value.label)
        for key, param in step.ph.items()
        for value in param.values
        if isinstance(value, Element) and (value.id or value.label)  # else a default that the plan leaves open
    }
    return Call(step.name, step.manager, frozenset(arguments))


def _worse(expected: Answer, got: Answer, recording: Recording, goal: Acted, settings: Settings) -> str:
    """In what way an answer is worse than the recorded one; "" when it is as good."""
    if got.code != expected.code:
        return "is another verdict"
    if got.code != PLAN or got.calls == expected.calls:
        return ""
    if len(got.calls) > len(expected.calls):
        return "is longer"
    model = world_of(scene_before(recording, goal.order), settings.workspace)
    task = TaskPlanner(LocalWorldModel("replay", model), None, Limits()).look(goal.content.goals)  # type: ignore[arg-type]
    try:
        wrong = validate(task, [_step(task, call) for call in got.calls])
    except WrongValue as error:
        wrong = str(error)
    return f"does not work: {wrong}" if wrong else ""


def _step(task: PlanningTask, call: Call) -> PlanStep:
    """The step of a planning task that a call is.

    :raises WrongValue: there is none.
    """
    values = dict(call.arguments)
    for action in task.actions:
        robots = [robot for robot, manager in action.managers if same_node(manager, call.manager)]
        if action.skill.label != call.label or not robots:
            continue
        arguments = [robots[0] if v.name == action.robot else values.get(v.key, "") for v in action.variables]
        return PlanStep(action.name, tuple(arguments))
    raise WrongValue(f"{call}: no such skill is known")
