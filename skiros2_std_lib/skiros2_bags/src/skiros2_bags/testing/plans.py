"""Makes the plans of a recording again, from the recorded world, and compares them."""

from __future__ import annotations

import json
import operator
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.testing.recorded_world import scene_before, world_model_with
from skiros2_bags.testing.recording import ActionMessage, Recording
from skiros2_msgs.msg import AchieveFeedback, AchieveResult
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.execution import MAX_FAILURES
from skiros2_task.core.planners import DEFAULT_ENGINE, Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.skills import Skill
from skiros2_task.core.store import Durations
from skiros2_world_model.core.local_world_model import LocalWorldModel
from skiros2_world_model.core.scene import Scene

#: The action of task managers whose feedback has the plan.
ACTION = "/achieve"

#: Differences of makespans below this are rounding (s).
_ROUNDING = 1e-6

#: The time for a better plan, after one that is worse than the recorded one (s).
_SECONDS = 10.0

#: A step as JSON data; see `skiros2_task.core.plan.Step.to_dict`.
Step = dict[str, Any]


@dataclass(frozen=True)
class RecordedPlan:
    """A plan for a goal: the first one, or one that was made after a failure or a change of the scene.

    :param orders: of the messages before which its world may be: the last one before it was made, and the one with it,
        as changes of the world model may be recorded late.
    :param number: which plan of the goal, from 1.
    :param steps: numbered from 1; none without a plan.
    :param state: of the goal's result, without a plan.
    :param avoided: (manager, skill label) pairs that had failed too often.
    :param has_running: whether steps ran meanwhile, whose effects were assumed.
    """

    goal: ActionMessage
    orders: tuple[int, ...]
    number: int
    steps: tuple[Step, ...]
    state: str
    avoided: frozenset[tuple[str, str]] = frozenset()
    has_running: bool = False

    def __str__(self) -> str:
        return f"goal {self.goal.content.goals}{f', plan {self.number}' if self.number > 1 else ''}"


@dataclass(frozen=True)
class PlanComparison:
    """How the plans of today differ from the recorded ones, a text for each.

    :param worse: plans with a longer makespan, and goals with another outcome.
    :param different: other plans of the same or a shorter makespan.
    :param not_compared: plans that are not made again, and why.
    """

    worse: tuple[str, ...] = ()
    different: tuple[str, ...] = ()
    not_compared: tuple[str, ...] = ()


def recorded_plans(recording: Recording) -> list[RecordedPlan]:
    """Returns the plans for each goal that a task manager was to achieve, with a plan or a result.

    A goal that came with its plan is left out.

    :raises BagError: a recorded plan cannot be read.
    """
    found = []
    for goal in recording.action_messages:
        if goal.part == "goal" and goal.action.endswith(ACTION) and not goal.content.wish.lstrip().startswith("["):
            found += _plans_for(recording, goal)
    return found


def _plans_for(recording: Recording, goal: ActionMessage) -> Iterator[RecordedPlan]:
    order, known, number = goal.order, 0, 1
    is_planning, has_running = True, False
    failed: dict[int, tuple[str, str]] = {}  # manager and label by step
    for event in recording.action_messages:
        if (event.action, event.part, event.goal_id) != (goal.action, "feedback", goal.goal_id):
            continue
        steps, states = _json(event, event.content.plan), _json(event, event.content.steps)
        calls = {step["number"]: (step["robot"], step["label"]) for step in steps}
        failed |= {s["number"]: calls[s["number"]] for s in states if s["state"] == "failed" and s["number"] in calls}
        new = [step for step in steps if step["number"] > known]
        if new:
            avoided = frozenset(key for key, times in Counter(failed.values()).items() if times >= MAX_FAILURES)
            orders, renumbered = (order, event.order), tuple(_from_one(step, known) for step in new)
            yield RecordedPlan(goal, orders, number, renumbered, "", avoided, has_running)
            known, number, is_planning = max(step["number"] for step in new), number + 1, False
        elif event.content.phase == AchieveFeedback.PLANNING or not known:  # it waited, or was being planned
            order, is_planning = event.order, True
            has_running = any(step["state"] == "running" for step in states)
    result = recording.result(goal)
    if result is not None and is_planning and (not known or result.content.state == AchieveResult.IMPOSSIBLE):
        yield RecordedPlan(goal, (order, result.order), number, (), result.content.state, has_running=has_running)


def _from_one(step: Step, known: int) -> Step:
    return {**step, "number": step["number"] - known, "after": [n - known for n in step["after"] if n > known]}


def _json(feedback: ActionMessage, text: str) -> list[Step]:
    try:
        return list(json.loads(text))
    except (ValueError, TypeError) as error:
        raise BagError(f"{feedback.action}: a recorded plan cannot be read: {error}") from error


def compare_plans(recording: Recording, workspace: Path | None) -> PlanComparison:
    """Plans for each recorded goal with the recorded world, the recorded durations and today's planner.

    A plan that is worse is made again, as the best one within some seconds.

    :param workspace: folder of additional ontologies for the scene.
    :raises BagError: the bag lacks changes of the world model.
    """
    worse: list[str] = []
    different: list[str] = []
    plans = recorded_plans(recording)
    not_compared = [f"{plan}: it was made while steps ran" for plan in plans if plan.has_running]
    plans = [plan for plan in plans if not plan.has_running]
    processes = EngineProcesses()
    try:
        for recorded in plans:
            result = _plan_again(recording, recorded, workspace, processes)
            text = f"{recorded}: recorded {_recorded_text(recorded)}; now {_text_of(result)}"
            if _is_worse(recorded, result):
                worse.append(text)
            elif not _is_same(recorded, result):
                different.append(text)
    finally:
        processes.close()
    return PlanComparison(tuple(worse), tuple(different), tuple(not_compared))


def _plan_again(
    recording: Recording, recorded: RecordedPlan, workspace: Path | None, processes: EngineProcesses
) -> PlanningResult:
    """Returns the result for the first world in which it is as recorded; without one, the best result."""
    results = []
    for scene in _scenes(recording, recorded):
        model = world_model_with(scene, workspace)
        request, name = recorded.goal.content, str(recording.parameters.get("/tm/planner", DEFAULT_ENGINE))
        engine = planner_named(processes, request.wish or name)
        limits = Limits(request.seconds or float(recording.parameters.get("/tm/planning_time", Limits.seconds)))
        durations = RecordedDurations(recorded.steps)
        planner = TaskPlanner(LocalWorldModel("planner", model), engine, limits, durations=durations)
        for avoided in dict.fromkeys((recorded.avoided, frozenset[tuple[str, str]]())):
            adapt = operator.methodcaller("without_skills", avoided)
            result = planner.plan(request.goals, adapt=adapt)
            if _is_worse(recorded, result):
                best = planner_named(processes, Quality.BEST.value)
                shorter = Limits(min(limits.seconds, _SECONDS))
                result = planner.plan(request.goals, planner=best, limits=shorter, adapt=adapt)
            if _is_same(recorded, result):
                return result
            results.append(result)
    return min(results, key=lambda result: _is_worse(recorded, result))


def _scenes(recording: Recording, recorded: RecordedPlan) -> Iterator[Scene]:
    first, last = recorded.orders[0], recorded.orders[-1]
    yield scene_before(recording, first)
    if any(first < event.order < last for event in recording.changes):
        yield scene_before(recording, last)


class RecordedDurations(Durations):
    """The durations with which a recorded plan was scheduled."""

    def __init__(self, steps: Sequence[Step]) -> None:
        super().__init__()
        self._recorded = {(s["skill"], s["robot"].strip("/")): s["end"] - s["start"] for s in steps}

    def seconds(self, skill: Skill, manager: str) -> float:
        recorded = self._recorded.get((skill.name, manager.strip("/")))
        return super().seconds(skill, manager) if recorded is None else recorded


def _is_worse(recorded: RecordedPlan, result: PlanningResult) -> bool:
    if not recorded.steps:
        return result.verdict.state != recorded.state and result.plan is None
    return result.plan is None or result.plan.makespan > _makespan(recorded.steps) + _ROUNDING


def _is_same(recorded: RecordedPlan, result: PlanningResult) -> bool:
    if not recorded.steps:
        return result.verdict.state == recorded.state
    steps = json.loads(json.dumps([step.to_dict() for step in result.plan.steps])) if result.plan is not None else []
    return [_content(step) for step in recorded.steps] == [_content(step) for step in steps]


def _content(step: Step) -> tuple[object, ...]:
    return step["skill"], step["label"], step["robot"].strip("/"), step["arguments"], step["after"]


def _makespan(steps: Sequence[Step]) -> float:
    return max((float(step["end"]) for step in steps), default=0.0)


def _recorded_text(recorded: RecordedPlan) -> str:
    return _text(recorded.steps) if recorded.steps else recorded.state


def _text_of(result: PlanningResult) -> str:
    if result.verdict is not Verdict.PLANNED or result.plan is None:
        return f"{result.verdict.state}: {result.message}" if result.message else result.verdict.state
    return _text([step.to_dict() for step in result.plan.steps])


def _text(steps: Sequence[Step]) -> str:
    """Returns the makespan and the steps of a plan, with what each waits for."""
    shown = (
        f"{s['number']} {s['label']} by {s['robot'].strip('/')} ({', '.join(map(str, s['arguments'].values()))})"
        + (f" after {', '.join(map(str, s['after']))}" if s["after"] else "")
        for s in steps
    )
    return f"{_makespan(steps):g} s: {'; '.join(shown)}"
