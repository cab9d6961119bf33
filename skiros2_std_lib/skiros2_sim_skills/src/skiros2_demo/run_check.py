"""Proves from a bag alone that a goal was planned for, that every skill on the way succeeded, and that it was reached.

Needs no ROS: the message definitions are in the bag.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.names import full_name
from skiros2_demo.world_state import WorldState
from skiros2_task.core import goal_syntax

MONITOR = "skiros2_msgs/msg/WmMonitor"
PROGRESS = "skiros2_msgs/msg/TreeProgress"
GOAL = "skiros2_msgs/msg/AssignTaskActionGoal"
RESULT = "skiros2_msgs/msg/AssignTaskActionResult"
NEEDED = {
    MONITOR: "changes of the world model",
    GOAL: "goals for the task manager",
    RESULT: "plans of the task manager",
}

NOTHING_TO_DO, PLAN_FOUND = 2, 3  # result codes of the task manager
STATE_NAMES = {1: "Success", 2: "Failure", 3: "Running", 4: "Idle"}


class BagError(SkirosError):
    """The bag cannot be read, or lacks what the proof needs."""


@dataclass(frozen=True)
class Finding:
    """One step of the proof."""

    holds: bool
    text: str


@dataclass
class Run:
    """What a bag holds of one run."""

    before: WorldState = field(default_factory=WorldState)  #: the world when the last goal was given
    after: WorldState = field(default_factory=WorldState)  #: the world at the end
    goals: str = ""  #: the last goal
    result: Any = None  #: the task manager's answer to it
    trees: dict[tuple[str, int], list[Any]] = field(default_factory=dict)
    #: (agent's topic, task id) -> the last progress of every node, since that goal


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
                goal_id, run.goals, run.result = message.goal_id.id, message.goal.goals, None
                run.before, run.trees = run.after.copy(), {}
            elif kind == RESULT and message.status.goal_id.id == goal_id:
                run.result = message
            elif kind == PROGRESS and message.progress:
                run.trees[topic, message.progress[0].task_id] = message.progress
    except SkirosError as error:
        raise BagError(f"{bag}: {error}") from error
    if goal_id is None:
        raise BagError(f"{bag}: no goal was given to a task manager")
    return run


def check(run: Run) -> list[Finding]:
    """The proof, step by step.

    :raises BagError: the goal is of a kind that cannot be judged from a bag.
    """
    findings = [_check_plan(run)]
    if findings[0].holds and run.result.result.progress_code == PLAN_FOUND:
        findings += _check_tasks(run)
    return findings + _check_goal(run)


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
            wanted = [c for c in reader.connections if c.msgtype in (*NEEDED, PROGRESS)]
            for connection in wanted:
                store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
            for connection, _, data in reader.messages(connections=wanted):
                yield connection.topic, store.deserialize_ros1(data, connection.msgtype)
    except (ReaderError, SerdeError, TypesysError, OSError) as error:
        raise BagError(f"the bag cannot be read: {error}") from error


# -- the plan and its execution ---------------------------------------------------------------------------------------


def _check_plan(run: Run) -> Finding:
    if run.result is None:
        return Finding(False, f"the task manager did not answer the goal {run.goals}")
    code, text = run.result.result.progress_code, run.result.result.progress_message
    if code == NOTHING_TO_DO:
        return Finding(True, "the goal was reached already, there was nothing to do")
    if code != PLAN_FOUND:
        return Finding(False, f"the task manager found no plan: {text}")
    return Finding(True, f"a plan was made: {', '.join(_plan(run))}")


def _plan(run: Run) -> list[str]:
    """The labels of the plan's skills."""
    try:
        return [step["name"] for step in json.loads(run.result.result.progress_message)["children"]]
    except (ValueError, KeyError, TypeError) as error:
        raise BagError(f"the plan cannot be read: {error!r}") from error


def _check_tasks(run: Run) -> list[Finding]:
    if not run.trees:
        return [Finding(False, "the plan was not run")]
    findings = []
    for (topic, task_id), nodes in sorted(run.trees.items()):
        agent = topic.removesuffix("/monitor")
        root, skills = nodes[0], nodes[1:]
        bad = [n for n in skills if n.state != n.SUCCESS]
        findings += [
            Finding(False, f"{agent}, task {task_id}: {n.label or n.type} ended as {STATE_NAMES.get(n.state, n.state)}"
                           f": {n.progress_message}")
            for n in bad
        ]  # fmt: skip
        if abs(root.progress_code) != 1:
            findings.append(Finding(False, f"{agent}, task {task_id}: did not end"))
        elif root.state != root.SUCCESS:
            findings.append(Finding(False, f"{agent}, task {task_id}: failed: {root.progress_message}"))
        elif not bad:
            findings.append(Finding(True, f"{agent}, task {task_id}: all {len(skills)} skills succeeded"))
    ran = [n.label for nodes in run.trees.values() for n in nodes[1:] if n.parent_id == nodes[0].id]
    plan = _plan(run)
    as_planned = sorted(ran) == sorted(plan) if len(run.trees) > 1 else ran == plan
    return [Finding(as_planned, "the plan was followed" if as_planned else f"run was: {', '.join(ran)}"), *findings]


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
