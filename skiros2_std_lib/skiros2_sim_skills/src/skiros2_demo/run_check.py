"""Proves from a bag alone that a goal was planned for, that robots did the steps, and that it was reached.

Needs no ROS: the message definitions are in the bag.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.names import full_name
from skiros2_demo.finding import Finding
from skiros2_demo.plan_text import Step, name_of, steps_of
from skiros2_demo.world_state import WorldState
from skiros2_task.core import goal_syntax

MONITOR = "skiros2_msgs/msg/WmMonitor"
PROGRESS = "skiros2_msgs/msg/TreeProgress"
GOAL = "skiros2_msgs/msg/AchieveActionGoal"
FEEDBACK = "skiros2_msgs/msg/AchieveActionFeedback"
RESULT = "skiros2_msgs/msg/AchieveActionResult"
NEEDED = {
    MONITOR: "changes of the world model",
    GOAL: "goals for the task manager",
    RESULT: "results of the task manager",
}

#: What a result says of a goal.
SUCCEEDED, NOTHING_TO_DO = "succeeded", "nothing_to_do"
#: State of a node on the wire -> what becomes of a step whose root ends so.
ENDS = {1: "succeeded", 2: "failed"}


class BagError(SkirosError):
    """The bag cannot be read, or lacks what the proof needs."""


@dataclass
class Run:
    """What a bag holds of one run."""

    before: WorldState = field(default_factory=WorldState)  #: the world when the last goal was given
    after: WorldState = field(default_factory=WorldState)  #: the world at the end
    goals: str = ""  #: the last goal
    plans: list[list[Step]] = field(default_factory=list)  #: the steps of each plan that was made for it
    result: Any = None  #: the task manager's answer to it
    trees: dict[tuple[str, int], list[Any]] = field(default_factory=dict)
    #: (agent's topic, task id) -> the last progress of every node, since that goal, in the order of their starts


def read_run(bag: Path) -> Run:
    """Reads the last goal of a bag and all that followed.

    :raises BagError: there is no such bag, it cannot be read, or lacks a kind of message.
    """
    run = Run()
    goal_id = None
    try:
        for topic, message in _messages(bag):
            kind = message.__msgtype__
            if kind == MONITOR:
                run.after.apply(message)
            elif kind == GOAL:
                goal_id = message.goal_id.id
                run = Run(run.after.copy(), run.after, message.goal.goals)
            elif kind == FEEDBACK and message.status.goal_id.id == goal_id:
                _take_plan(run, steps_of(message.feedback.plan))
            elif kind == RESULT and message.status.goal_id.id == goal_id:
                run.result = message.result
            elif kind == PROGRESS and message.progress:
                run.trees[topic, message.progress[0].task_id] = message.progress
    except SkirosError as error:
        raise BagError(f"{bag}: {error}") from error
    if goal_id is None:
        raise BagError(f"{bag}: no goal was given to a task manager")
    return run


def check(run: Run) -> list[Finding]:
    """The proof, step by step.

    :raises BagError: the goal is of a kind that cannot be judged from a bag, or a result cannot be read.
    """
    return [*_check_result(run), *_check_goal(run)]


def _take_plan(run: Run, plan: list[Step]) -> None:
    known = max((step["number"] for steps in run.plans for step in steps), default=0)
    new = [step for step in plan if step["number"] > known]
    if new:
        run.plans.append(new)


# -- the bag ----------------------------------------------------------------------------------------------------------


def _messages(bag: Path) -> Iterator[tuple[str, Any]]:
    if not bag.is_file():
        raise BagError("there is no such file")
    try:
        with Reader(bag) as reader:
            kinds = {c.msgtype for c in reader.connections}
            missing = [what for kind, what in NEEDED.items() if kind not in kinds]
            if missing:
                raise BagError(f"the bag holds no {' and no '.join(missing)}")
            store = get_typestore(Stores.ROS1_NOETIC)
            wanted = [c for c in reader.connections if c.msgtype in (*NEEDED, FEEDBACK, PROGRESS)]
            for connection in wanted:
                store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
            for connection, _, data in reader.messages(connections=wanted):
                yield connection.topic, store.deserialize_ros1(data, connection.msgtype)
    except (ReaderError, SerdeError, TypesysError, OSError) as error:
        raise BagError(f"the bag cannot be read: {error}") from error


# -- the plans and their execution ------------------------------------------------------------------------------------


def _check_result(run: Run) -> list[Finding]:
    if run.result is None:
        return [Finding(False, f"the task manager did not answer the goal {run.goals}")]
    if run.result.state == NOTHING_TO_DO:
        return [Finding(True, "the goal was reached already, there was nothing to do")]
    if run.result.state != SUCCEEDED:
        return [Finding(False, f"the goal ended as {run.result.state}: {run.result.message}")]
    plans = [f"a plan was made{' anew' if n else ''}: {_named(plan)}" for n, plan in enumerate(run.plans)]
    return [*(Finding(True, text) for text in plans), *_check_steps(run)]


def _check_steps(run: Run) -> list[Finding]:
    """What the result says of the steps is what the trees of the robots say."""
    try:
        done = steps_of(run.result.done)
    except WrongValue as error:
        raise BagError(str(error)) from error
    findings = []
    for robot in sorted({step["robot"] for step in done} | {topic.removesuffix("/monitor") for topic, _ in run.trees}):
        said = [(name_of(step), step["state"]) for step in done if step["robot"] == robot]
        trees = [nodes for (topic, _), nodes in run.trees.items() if topic == f"{robot}/monitor"]
        seen = [(_skills(nodes), _end(nodes)) for nodes in trees]
        findings.append(
            Finding(seen == said, f"{robot} did: {_told(seen)}" + ("" if seen == said else f"; said is: {_told(said)}"))
        )
    return findings


def _named(steps: list[Step]) -> str:
    return ", ".join(name_of(step) for step in steps)


def _told(steps: list[tuple[str, str]]) -> str:
    return ", ".join(name if state == SUCCEEDED else f"{name} ({state})" for name, state in steps) or "nothing"


def _skills(nodes: list[Any]) -> str:
    return ", ".join(node.label for node in nodes[1:] if node.parent_id == nodes[0].id)


def _end(nodes: list[Any]) -> str:
    root = nodes[0]
    return ENDS.get(root.state, "ended oddly") if abs(root.progress_code) == 1 else "did not end"


# -- the goal ---------------------------------------------------------------------------------------------------------


def _check_goal(run: Run) -> list[Finding]:
    try:
        goals = goal_syntax.parse_goals(run.goals)
    except WrongValue as error:
        raise BagError(str(error)) from error
    return [Finding(_holds(goal, run.after), f"at the end: {_worded(goal, run.after)}") for goal in goals]


def _holds(goal: goal_syntax.ParsedGoal, world: WorldState) -> bool:
    if isinstance(goal, goal_syntax.ParsedNot):
        return not _holds(goal.part, world)
    if isinstance(goal, goal_syntax.ParsedJunction):
        parts = [_holds(part, world) for part in goal.parts]
        return all(parts) if goal.every else any(parts)
    if isinstance(goal, goal_syntax.ParsedAtom) and len(goal.terms) == 2:
        subject, target = (term.text for term in goal.terms)
        for term in (subject, target):
            if term not in world.things:
                raise BagError(f"the goal speaks of {term}, which is not in the world at the end")
        return (subject, full_name(goal.predicate.text), target) in world.relations
    raise BagError("only goals about relations between elements can be judged from a bag")


def _worded(goal: goal_syntax.ParsedGoal, world: WorldState) -> str:
    if isinstance(goal, goal_syntax.ParsedNot):
        return f"not ({_worded(goal.part, world)})"
    if isinstance(goal, goal_syntax.ParsedJunction):
        return f" {'and' if goal.every else 'or'} ".join(_worded(part, world) for part in goal.parts)
    assert isinstance(goal, goal_syntax.ParsedAtom)
    subject, target = (world.name(term.text) for term in goal.terms)
    relation = full_name(goal.predicate.text)
    return f"{target} is in {subject}" if relation == "skiros:contain" else f"{subject} {relation} {target}"
