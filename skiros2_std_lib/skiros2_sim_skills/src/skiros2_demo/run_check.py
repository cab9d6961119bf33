"""Proves from a bag alone that a goal was planned for, that robots did the steps, and that it was reached.

Needs no ROS: the message definitions are in the bag.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from skiros2_bags.core.action_call import Goal
from skiros2_bags.core.checking import Finding
from skiros2_bags.core.checking import check as look_for_gaps
from skiros2_bags.core.errors import BagError
from skiros2_bags.core.run import Run
from skiros2_bags.core.task_run import FAILURE, SUCCESS, TaskRun
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import full_name
from skiros2_demo.plan_text import Step, name_of, steps_of
from skiros2_demo.world_state import WorldState
from skiros2_task.core import goal_text

ACHIEVE = "skiros2_msgs/Achieve"
PROGRESS = "skiros2_msgs/TreeProgress"

#: What a result says of a goal.
SUCCEEDED, NOTHING_TO_DO = "succeeded", "nothing_to_do"
#: What becomes of a step whose tree ends so.
_ENDS = {SUCCESS: "succeeded", FAILURE: "failed"}


@dataclass
class Pursuit:
    """What a bag tells of how its last goal was pursued.

    :param missing: what should be in the bag, and is not.
    :param before, after: the world when it was given, and at the end.
    :param plans: the steps of each plan that was made for it.
    :param done: what the task manager says of the steps that were started.
    :param tasks: those that began since then, on all robots.
    """

    missing: list[str]
    goal: Goal
    before: WorldState
    after: WorldState
    plans: list[list[Step]] = field(default_factory=list)
    done: list[Step] = field(default_factory=list)
    tasks: list[TaskRun] = field(default_factory=list)


def read_run(bag: Path) -> Pursuit:
    """Reads the last goal of a bag and all that followed.

    :raises BagError: there is no such bag, it cannot be read or is cut off, or lacks a kind of message.
    """
    run = Run.open(bag)
    if run.damage:
        raise BagError(f"{bag}: {run.damage}")
    goals = [goal for goal in run.goals() if goal.call.type == ACHIEVE]
    if not goals:
        raise BagError(f"{bag}: no goal was given to a task manager to be achieved")
    goal = goals[-1]
    missing = [finding.text for finding in look_for_gaps(run) if not finding.holds]
    pursuit = Pursuit(missing, goal, _world(run, goal.time), _world(run, run.end))
    if PROGRESS in run.topics.values():
        pursuit.tasks = [task for task in run.tasks() if task.start >= goal.time]
    try:
        for message in goal.call.feedback:
            _take_plan(pursuit.plans, steps_of(message.content.feedback.plan))
        if goal.call.result is not None:
            pursuit.done = steps_of(goal.call.result.content.result.done)
    except WrongValue as error:
        raise BagError(f"{bag}: {error}") from error
    return pursuit


def check(pursuit: Pursuit) -> list[Finding]:
    """The proof, step by step.

    :raises BagError: the goal is of a kind that cannot be judged from a bag.
    """
    whole = Finding(not pursuit.missing, "; ".join(pursuit.missing) or "the bag has all of the run from its start")
    return [whole, *_check_result(pursuit), *_check_goal(pursuit)]


def _world(run: Run, at: float) -> WorldState:
    scene = run.world(at)
    return WorldState.of(element for node in scene if (element := scene.element(node.id)) is not None)


def _take_plan(plans: list[list[Step]], plan: list[Step]) -> None:
    known = max((step["number"] for steps in plans for step in steps), default=0)
    new = [step for step in plan if step["number"] > known]
    if new:
        plans.append(new)


# -- the plans and their execution ------------------------------------------------------------------------------------


def _check_result(pursuit: Pursuit) -> list[Finding]:
    goal = pursuit.goal
    if not goal.state:
        return [Finding(False, f"the task manager did not answer the goal {goal.goals}")]
    if goal.state == NOTHING_TO_DO:
        return [Finding(True, "the goal was reached already, there was nothing to do")]
    if goal.state != SUCCEEDED:
        return [Finding(False, f"the goal ended as {goal.state}: {goal.message}")]
    plans = [f"a plan was made{' anew' if n else ''}: {_named(plan)}" for n, plan in enumerate(pursuit.plans)]
    return [*(Finding(True, text) for text in plans), *_check_steps(pursuit)]


def _check_steps(pursuit: Pursuit) -> list[Finding]:
    """What the result says of the steps is what the trees of the robots say."""
    findings = []
    for robot in sorted({step["robot"] for step in pursuit.done} | {task.robot for task in pursuit.tasks}):
        said = [(name_of(step), step["state"]) for step in pursuit.done if step["robot"] == robot]
        seen = [(_skills(task), _end(task)) for task in pursuit.tasks if task.robot == robot]
        findings.append(
            Finding(seen == said, f"{robot} did: {_told(seen)}" + ("" if seen == said else f"; said is: {_told(said)}"))
        )
    return findings


def _named(steps: list[Step]) -> str:
    return ", ".join(name_of(step) for step in steps)


def _told(steps: list[tuple[str, str]]) -> str:
    return ", ".join(name if state == SUCCEEDED else f"{name} ({state})" for name, state in steps) or "nothing"


def _skills(task: TaskRun) -> str:
    return ", ".join(node.name for node in task.nodes.values() if node.depth == 1)


def _end(task: TaskRun) -> str:
    return _ENDS.get(task.root.state, "stopped") if task.has_ended else "did not end"


# -- the goal ---------------------------------------------------------------------------------------------------------


def _check_goal(pursuit: Pursuit) -> list[Finding]:
    try:
        goals = goal_text.parse_goals(pursuit.goal.goals)
    except WrongValue as error:
        raise BagError(str(error)) from error
    return [Finding(_holds(goal, pursuit.after), f"at the end: {_worded(goal, pursuit.after)}") for goal in goals]


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


def _worded(goal: goal_text.ParsedGoal, world: WorldState) -> str:
    if isinstance(goal, goal_text.ParsedNot):
        return f"not ({_worded(goal.part, world)})"
    if isinstance(goal, goal_text.ParsedJunction):
        return f" {'and' if goal.every else 'or'} ".join(_worded(part, world) for part in goal.parts)
    assert isinstance(goal, goal_text.ParsedAtom)
    subject, target = (world.name(term.text) for term in goal.terms)
    relation = full_name(goal.predicate.text)
    return f"{target} is in {subject}" if relation == "skiros:contain" else f"{subject} {relation} {target}"
