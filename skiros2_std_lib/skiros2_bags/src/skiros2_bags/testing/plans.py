"""Makes the plans of a recording again, from the recorded world, and compares them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skiros2_bags.core.bag_file import BagError
from skiros2_bags.testing.recorded_world import scene_before, world_model_with
from skiros2_bags.testing.recording import ActionMessage, Recording
from skiros2_task.core.engines import EngineProcesses, Limits
from skiros2_task.core.planners import DEFAULT_ENGINE, Quality, planner_named
from skiros2_task.core.planning import PlanningResult, TaskPlanner, Verdict
from skiros2_task.core.skills import Skill
from skiros2_task.core.store import Durations
from skiros2_world_model.core.local_world_model import LocalWorldModel

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
    """The first plan for a goal.

    :param order: of the last message before it was made.
    :param state: of the goal's result; "" without one.
    """

    goal: ActionMessage
    order: int
    steps: tuple[Step, ...]
    state: str


@dataclass(frozen=True)
class PlanComparison:
    """How the plans of today differ from the recorded ones, a text for each.

    :param worse: plans with a longer makespan, and goals with another outcome.
    :param different: other plans of the same or a shorter makespan.
    """

    worse: tuple[str, ...] = ()
    different: tuple[str, ...] = ()


def recorded_plans(recording: Recording) -> list[RecordedPlan]:
    """Returns the first plan for each goal that a task manager was to achieve, with a plan or a result.

    A goal that came with its plan is left out.

    :raises BagError: a recorded plan cannot be read.
    """
    found = []
    for goal in recording.action_messages:
        if goal.part == "goal" and goal.action.endswith(ACTION) and not goal.content.wish.lstrip().startswith("["):
            result, order, steps = recording.result(goal), goal.order, ()
            for event in recording.action_messages:
                if (event.action, event.part, event.goal_id) == (goal.action, "feedback", goal.goal_id):
                    steps = _steps(event)
                    if steps:
                        break
                    order = event.order  # it waited, or was being planned
            if steps or result is not None:
                found.append(RecordedPlan(goal, order, steps, result.content.state if result is not None else ""))
    return found


def _steps(feedback: ActionMessage) -> tuple[Step, ...]:
    try:
        return tuple(json.loads(feedback.content.plan))
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
    if not plans:
        return PlanComparison()
    processes = EngineProcesses()
    try:
        for recorded in plans:
            model = world_model_with(scene_before(recording, recorded.order), workspace)
            request, name = recorded.goal.content, str(recording.parameters.get("/tm/planner", DEFAULT_ENGINE))
            engine = planner_named(processes, request.wish or name)
            limits = Limits(request.seconds or float(recording.parameters.get("/tm/planning_time", Limits.seconds)))
            durations = RecordedDurations(recorded.steps)
            planner = TaskPlanner(LocalWorldModel("planner", model), engine, limits, durations=durations)
            result = planner.plan(request.goals)
            if _is_worse(recorded, result):
                best = planner_named(processes, Quality.BEST.value)
                result = planner.plan(request.goals, planner=best, limits=Limits(min(limits.seconds, _SECONDS)))
            text = f"goal {request.goals}: recorded {_recorded_text(recorded)}; now {_text_of(result)}"
            if _is_worse(recorded, result):
                worse.append(text)
            elif not _is_same(recorded, result):
                different.append(text)
    finally:
        processes.close()
    return PlanComparison(tuple(worse), tuple(different))


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
