"""Checks from a bag alone that a goal was planned, that robots executed the steps, and that it was reached.

Needs no ROS.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from skiros2_bags.core.action_call import Goal
from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.run import Finding, Run
from skiros2_bags.core.run import check as check_bag
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import full_name
from skiros2_demo.plan_text import Step, name_of, steps_of
from skiros2_demo.world_state import WorldState
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_task.core import goal_text

ACHIEVE = "skiros2_msgs/Achieve"
PROGRESS = "skiros2_msgs/TreeProgress"

#: States of a goal's result.
SUCCEEDED, NOTHING_TO_DO = "succeeded", "nothing_to_do"
#: State of a step by the final state of its task.
_ENDS = {TaskState.SUCCEEDED: "succeeded", TaskState.FAILED: "failed", TaskState.PREEMPTED: "failed"}


@dataclass
class GoalRun:
    """The execution of the last goal in a bag.

    :param missing: what is missing in the bag.
    :param before, after: the world at the time of the goal, and at the end.
    :param plans: the steps of each plan.
    :param done: the started steps, as reported by the task manager.
    :param tasks: the tasks of all robots since the goal.
    """

    missing: list[str]
    goal: Goal
    before: WorldState
    after: WorldState
    plans: list[list[Step]] = field(default_factory=list)
    done: list[Step] = field(default_factory=list)
    tasks: list[TaskRun] = field(default_factory=list)


def read_run(bag: Path) -> GoalRun:
    """Reads the last goal of a bag and its execution.

    :raises BagError: the bag cannot be read, is truncated, or lacks a type of messages.
    """
    run = Run.open(bag)
    if run.damage:
        raise BagError(f"{bag}: {run.damage}")
    goals = [goal for goal in run.goals() if goal.call.type == ACHIEVE]
    if not goals:
        raise BagError(f"{bag}: no goal was given to a task manager to be achieved")
    goal = goals[-1]
    missing = [finding.text for finding in check_bag(run) if not finding.holds]
    goal_run = GoalRun(missing, goal, _world(run, goal.time), _world(run, run.end))
    if PROGRESS in run.topics.values():
        goal_run.tasks = [task for task in run.tasks() if task.start >= goal.time]
    try:
        for message in goal.call.feedback:
            _add_plan(goal_run.plans, steps_of(message.content.feedback.plan))
        if goal.call.result is not None:
            goal_run.done = steps_of(goal.call.result.content.result.done)
    except WrongValue as error:
        raise BagError(f"{bag}: {error}") from error
    return goal_run


def check(goal_run: GoalRun) -> list[Finding]:
    """Checks the execution of a goal.

    :raises BagError: a goal of this kind cannot be checked from a bag.
    """
    whole = Finding(not goal_run.missing, "; ".join(goal_run.missing) or "the bag has all of the run from its start")
    return [whole, *_check_result(goal_run), *_check_goal(goal_run)]


def _world(run: Run, at: float) -> WorldState:
    scene = run.world(at)
    return WorldState.of(element for node in scene if (element := scene.element(node.id)) is not None)


def _add_plan(plans: list[list[Step]], plan: list[Step]) -> None:
    known = max((step["number"] for steps in plans for step in steps), default=0)
    new = [step for step in plan if step["number"] > known]
    if new:
        plans.append(new)


# -- the plans and their execution ------------------------------------------------------------------------------------


def _check_result(goal_run: GoalRun) -> list[Finding]:
    goal = goal_run.goal
    if not goal.state:
        return [Finding(False, f"the task manager did not answer the goal {goal.goals}")]
    if goal.state == NOTHING_TO_DO:
        return [Finding(True, "the goal was reached already, there was nothing to do")]
    if goal.state != SUCCEEDED:
        return [Finding(False, f"the goal ended as {goal.state}: {goal.message}")]
    kinds = ["a plan", *["another plan"] * (len(goal_run.plans) - 1)]
    plans = [f"{kind} was made: {_with_names(plan)}" for kind, plan in zip(kinds, goal_run.plans, strict=False)]
    return [*(Finding(True, text) for text in plans), *_check_steps(goal_run)]


def _check_steps(goal_run: GoalRun) -> list[Finding]:
    """Compares the steps in the result with the task runs of the robots."""
    findings = []
    for robot in sorted({step["robot"] for step in goal_run.done} | {task.robot for task in goal_run.tasks}):
        reported = [(name_of(step), step["state"]) for step in goal_run.done if step["robot"] == robot]
        recorded = [(task.latest.shape.skills_text(), _end(task)) for task in goal_run.tasks if task.robot == robot]
        difference = "" if recorded == reported else f"; said is: {_step_list(reported)}"
        findings.append(Finding(recorded == reported, f"{robot} did: {_step_list(recorded)}{difference}"))
    return findings


def _with_names(steps: list[Step]) -> str:
    return ", ".join(name_of(step) for step in steps)


def _step_list(steps: list[tuple[str, str]]) -> str:
    return ", ".join(name if state == SUCCEEDED else f"{name} ({state})" for name, state in steps) or "nothing"


def _end(task: TaskRun) -> str:
    return _ENDS.get(task.state, "did not end")


# -- the goal ---------------------------------------------------------------------------------------------------------


def _check_goal(goal_run: GoalRun) -> list[Finding]:
    try:
        goals = goal_text.parse_goals(goal_run.goal.goals)
    except WrongValue as error:
        raise BagError(str(error)) from error
    return [Finding(_holds(goal, goal_run.after), f"at the end: {_goal_text(goal, goal_run.after)}") for goal in goals]


def _holds(goal: goal_text.ParsedGoal, world: WorldState) -> bool:
    if isinstance(goal, goal_text.ParsedNot):
        return not _holds(goal.part, world)
    if isinstance(goal, goal_text.ParsedJunction):
        parts = [_holds(part, world) for part in goal.parts]
        return all(parts) if goal.every else any(parts)
    if isinstance(goal, goal_text.ParsedAtom) and len(goal.terms) == 2:
        subject, target = (term.text for term in goal.terms)
        for term in (subject, target):
            if term not in world.things:
                raise BagError(f"the goal speaks of {term}, which is not in the world at the end")
        return (subject, full_name(goal.predicate.text), target) in world.relations
    raise BagError("only goals about relations between elements can be judged from a bag")


def _goal_text(goal: goal_text.ParsedGoal, world: WorldState) -> str:
    if isinstance(goal, goal_text.ParsedNot):
        return f"not ({_goal_text(goal.part, world)})"
    if isinstance(goal, goal_text.ParsedJunction):
        return f" {'and' if goal.every else 'or'} ".join(_goal_text(part, world) for part in goal.parts)
    assert isinstance(goal, goal_text.ParsedAtom)
    subject, target = (world.name(term.text) for term in goal.terms)
    relation = full_name(goal.predicate.text)
    return f"{target} is in {subject}" if relation == "skiros:contain" else f"{subject} {relation} {target}"
