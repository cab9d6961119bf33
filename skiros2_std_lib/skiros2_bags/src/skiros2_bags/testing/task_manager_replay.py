"""Replay of the task manager alone: it must plan as well as recorded for the recorded goals and scenes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import actionlib
import rospy

from skiros2_bags.core.errors import BagError
from skiros2_bags.testing.divergence import Divergence
from skiros2_bags.testing.live_replay import WorldModelWriter
from skiros2_bags.testing.recorded_world import group_requests, scene_before, world_model_with
from skiros2_bags.testing.recording import ActionMessage, Recording
from skiros2_bags.testing.replay_settings import Settings
from skiros2_bags.testing.replay_system import ReplaySystem, start_task_manager, start_world_model
from skiros2_common.core.errors import TimedOut, WrongValue
from skiros2_common.core.manager_names import same_node
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

#: Timeout for the start and for answers of the task manager (s).
TIMEOUT = 60.0


@dataclass(frozen=True)
class PlanCall:
    """A step of a plan: label of the skill, manager of its robot, and ids of elements by parameter key."""

    label: str
    manager: str
    arguments: frozenset[tuple[str, str]]

    def __str__(self) -> str:
        values = ", ".join(f"{key}={value}" for key, value in sorted(self.arguments))
        return f"{self.label} by {self.manager}: {values}"


@dataclass(frozen=True)
class Answer:
    """The answer to a goal: `PLAN`, `NOTHING_TO_DO` or `FAILED`, with the steps or the reason."""

    code: int
    calls: tuple[PlanCall, ...] = ()
    message: str = ""

    def __str__(self) -> str:
        if self.code == PLAN:
            return "\n".join(f"{number}. {call}" for number, call in enumerate(self.calls, 1))
        return "nothing to do" if self.code == NOTHING_TO_DO else f"no plan: {self.message}"


def replay_task_manager(recording: Recording, settings: Settings, system: ReplaySystem) -> Divergence | None:
    """Plans for all recorded goals. Returns the first plan that fails or is longer than recorded; None without one."""
    goals = [(goal, answer) for goal in _goals(recording) if (answer := _recorded_answer(recording, goal)) is not None]
    if not goals:
        raise BagError(f"{recording.path}: no goals with plans; expected some on {ACHIEVE_ACTION} or {PLAN_ACTION}")
    begin = goals[0][0].order
    start_world_model(system, scene_before(recording, begin), settings.workspace, [])
    start_task_manager(system, recording)
    client = actionlib.SimpleActionClient(PLAN_ACTION, msgs.AssignTaskAction)
    if not client.wait_for_server(rospy.Duration.from_sec(TIMEOUT)):
        raise TimedOut(f"no task manager on {PLAN_ACTION} within {TIMEOUT:g} s")
    writer = WorldModelWriter()
    requests = group_requests([e for e in recording.changes if e.order > begin])
    for goal, expected in goals:
        while requests and requests[0][0].order < goal.order:
            writer.apply(requests.pop(0))
        author = goal.content.author if goal.action == PLAN_ACTION else ""
        client.send_goal(msgs.AssignTaskGoal(author, goal.content.goals))
        if not client.wait_for_result(rospy.Duration.from_sec(TIMEOUT)):
            raise TimedOut(f"goal {goal.content.goals}: no answer of the task manager within {TIMEOUT:g} s")
        got = _answer(client.get_result())
        reason = _defect(expected, got, recording, goal, settings)
        if reason:
            where = f"{goal.time - recording.events[0].time:.3f} s, goal {goal.content.goals}"
            return Divergence(where, f"the plan {reason}", str(expected), str(got))
    return None


def _goals(recording: Recording) -> list[ActionMessage]:
    return [e for e in recording.action_messages if e.part == "goal" and e.action in (PLAN_ACTION, ACHIEVE_ACTION)]


def _recorded_answer(recording: Recording, goal: ActionMessage) -> Answer | None:
    """Returns the recorded answer to a goal; None without one."""
    result = recording.result(goal)
    if goal.action == PLAN_ACTION:
        return _answer(result.content) if result is not None else None
    for event in recording.action_messages:
        if event.part == "feedback" and event.goal_id == goal.goal_id and event.content.plan not in ("", "[]"):
            return Answer(PLAN, tuple(_call_from_feedback(step) for step in json.loads(event.content.plan)))
    if result is None:
        return None
    code = NOTHING_TO_DO if result.content.state == msgs.AchieveResult.NOTHING_TO_DO else FAILED
    return Answer(code, message=result.content.message)


def _call_from_feedback(step: dict[str, Any]) -> PlanCall:
    return PlanCall(step["label"], step["robot"], frozenset(step["arguments"].items()))


def _answer(result: Any) -> Answer:
    """Returns the answer in a result.

    :raises WrongValue: the plan cannot be read.
    """
    if result.progress_code != PLAN:
        return Answer(result.progress_code, message=result.progress_message)
    return Answer(PLAN, tuple(_call_from_plan(step) for step in deserialize_skill(result.progress_message).children))


def _call_from_plan(step: Any) -> PlanCall:
    arguments = {
        (key, value.id or value.label)
        for key, param in step.ph.items()
        for value in param.values
        if isinstance(value, Element) and (value.id or value.label)  # otherwise a default that the plan does not set
    }
    return PlanCall(step.name, step.manager, frozenset(arguments))


def _defect(expected: Answer, got: Answer, recording: Recording, goal: ActionMessage, settings: Settings) -> str:
    """Returns why an answer is worse than the recorded one; "" if it is not."""
    if got.code != expected.code:
        return "is another verdict"
    if got.code != PLAN or got.calls == expected.calls:
        return ""
    if len(got.calls) > len(expected.calls):
        return "is longer"
    model = world_model_with(scene_before(recording, goal.order), settings.workspace)
    task = TaskPlanner(LocalWorldModel("replay", model), None, Limits()).read_task(goal.content.goals)  # type: ignore[arg-type]
    try:
        reason = validate(task, [_step(task, call) for call in got.calls])
    except WrongValue as error:
        reason = str(error)
    return f"does not work: {reason}" if reason else ""


def _step(task: PlanningTask, call: PlanCall) -> PlanStep:
    """Returns the step of a planning task for a call.

    :raises WrongValue: the task has no such action.
    """
    values = dict(call.arguments)
    for action in task.actions:
        robots = [robot for robot, manager in action.managers if same_node(manager, call.manager)]
        if action.skill.label != call.label or not robots:
            continue
        arguments = [robots[0] if v.name == action.robot else values.get(v.key, "") for v in action.variables]
        return PlanStep(action.name, tuple(arguments))
    raise WrongValue(f"{call}: no such skill is known")
