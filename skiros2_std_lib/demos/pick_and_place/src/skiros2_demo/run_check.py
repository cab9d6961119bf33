"""Checks from a bag alone that a goal was planned, that robots executed the steps, and that it was reached.

Needs no ROS.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from skiros2_bags.core.action_call import Goal
from skiros2_bags.core.bag_file import BagError
from skiros2_bags.core.run import Finding, Run
from skiros2_bags.core.run import check as check_bag
from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import full_name, local_name
from skiros2_common.core.world_element import Element
from skiros2_runs.core.states import TaskState
from skiros2_runs.core.task_run import TaskRun
from skiros2_task.core import goal_text
from skiros2_world_model.core.history import changed_lines, difference

#: Subject, predicate, object.
Triple = tuple[str, str, str]

SELF = "-1"


@dataclass
class Thing:
    """An element without its relations."""

    id: str
    type: str
    label: str
    properties: dict[str, list[Any]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The label without prefix, or the id."""
        return local_name(self.label) or self.id

    @property
    def size(self) -> tuple[float, float, float]:
        """Edge lengths of its box (m); 0 without a size."""
        x, y, z = (float(next(iter(self.properties.get(f"skiros:Size{axis}", [])), 0.0)) for axis in "XYZ")
        return x, y, z


@dataclass
class WorldState:
    """Things and their relations."""

    things: dict[str, Thing] = field(default_factory=dict)
    relations: set[Triple] = field(default_factory=set)
    elements: list[Element] = field(default_factory=list)

    @classmethod
    def of(cls, elements: Iterable[Element]) -> WorldState:
        """Creates the state from elements."""
        state = cls(elements=list(elements))
        for element in state.elements:
            properties = {p.key: list(p.values) for p in element.properties}
            state.things[element.id] = Thing(element.id, element.type, element.label, properties)
            for relation in element.getRelations():
                subject, other = (element.id if end == SELF else end for end in (relation["src"], relation["dst"]))
                state.relations.add((subject, relation["type"], other))
        return state

    def name(self, thing_id: str) -> str:
        """Returns the name of a thing: its label without prefix, or its id."""
        thing = self.things.get(thing_id)
        return thing.name if thing is not None else thing_id

    def holders(self, thing_id: str, predicate: str) -> list[str]:
        """Returns the subjects of a relation to a thing."""
        return sorted(s for s, p, o in self.relations if p == predicate and o == thing_id)

    def labelled(self, label: str) -> Thing:
        """Returns the thing with a label.

        :raises UnknownName: there is not exactly one.
        """
        found = [thing for thing in self.things.values() if thing.label == label]
        if len(found) != 1:
            labels = ", ".join(sorted({t.label for t in self.things.values() if t.label})) or "none"
            problem = "several elements are" if found else "no element is"
            raise UnknownName(f"{problem} labelled {label!r} in the scene; labels there: {labels}")
        return found[0]


#: A step of a plan, as in the feedback of `~achieve`.
Step = dict[str, Any]


def steps_of(text: str) -> list[Step]:
    """Parses the steps of a plan.

    :param text: JSON of the task manager; "" for no steps.
    :raises WrongValue: it is not a plan.
    """
    try:
        steps = json.loads(text or "[]")
        if all(isinstance(step["number"], int) for step in steps):
            return list(steps)
    except (ValueError, KeyError, TypeError) as error:
        raise WrongValue(f"the plan cannot be read: {error!r} in {text!r}") from error
    raise WrongValue(f"the plan cannot be read: a step has no number in {text!r}")


def plan_lines(steps: list[Step], name: Callable[[str], str]) -> list[str]:
    """Formats a plan, one line per step.

    :param name: returns the name of an element.
    """
    return [f"{number}. {_step(step, name)}".rstrip() for number, step in enumerate(steps, 1)]


def _step(step: Step, name: Callable[[str], str]) -> str:
    facts = [f"{key}: {name(value)}" for key, value in step.get("arguments", {}).items() if key != "Robot"]
    return f"{name_of(step):<8} {'; '.join(facts)}"


def name_of(step: Step) -> str:
    """Returns the name of a step's skill."""
    return str(step.get("label") or step.get("skill", ""))


ACHIEVE = "skiros2_msgs/Achieve"
PROGRESS = "skiros2_msgs/TreeProgress"

#: States of a goal's result.
SUCCEEDED, NOTHING_TO_DO = "succeeded", "nothing_to_do"
#: State of a step that was preempted because it was not wanted any more.
STOPPED = "stopped"
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
    """Compares the steps in the result with the task runs of the robots, in the order of their starts there: steps of
    one robot that are sent at the same time may start in any order.
    """
    findings = []
    order = {(task.robot, task.task_id): number for number, task in enumerate(goal_run.tasks)}
    done = sorted(goal_run.done, key=lambda step: order.get((step["robot"], step.get("task", -1)), math.inf))
    for robot in sorted({step["robot"] for step in goal_run.done} | {task.robot for task in goal_run.tasks}):
        reported = [(name_of(step), step["state"]) for step in done if step["robot"] == robot]
        recorded = [(task.latest.shape.skills_text(), _end(task)) for task in goal_run.tasks if task.robot == robot]
        same = len(recorded) == len(reported) and all(map(_same_step, recorded, reported))
        difference = "" if same else f"; reported: {_step_list(reported)}"
        findings.append(Finding(same, f"{robot} did: {_step_list(recorded)}{difference}"))
    return findings


def _same_step(recorded: tuple[str, str], reported: tuple[str, str]) -> bool:
    """Whether a task is a step. Preemption handlers follow the skill of a preempted task."""
    is_same = recorded[0] == reported[0] or recorded[0].startswith(f"{reported[0]}, ")
    return is_same and (recorded[1] == reported[1] or (recorded[1], reported[1]) == ("failed", STOPPED))


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
                raise BagError(f"the goal names {term}, which is not in the world at the end")
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


#: Properties that change with every observation.
_POSES = re.compile(r"skiros:((Position|Orientation)[XYZW]|BaseFrameId|TfTimeStamp):")
_ID = re.compile(r"\b\w+:\w+-\d+\b")


def changes(before: WorldState, after: WorldState) -> list[str]:
    """Returns one line per difference, except poses: `+` added, `-` removed, `~` changed."""
    lines = changed_lines(difference(before.elements, after.elements))
    names = after if len(after.things) >= len(before.things) else before
    return [_ID.sub(lambda found: names.name(found[0]), line) for line in lines if not _POSES.search(line)]
