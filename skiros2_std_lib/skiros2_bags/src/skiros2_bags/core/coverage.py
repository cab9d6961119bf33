"""Which skills, conditions, branches and failures recorded runs have exercised."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_bags.core.bag_file import PROGRESS, BagError
from skiros2_bags.core.bag_writer import DECLARATIONS, EVIDENCE
from skiros2_bags.core.run import Run
from skiros2_runs.core.history import NodeHistory, node_histories
from skiros2_runs.core.progress import GROUP_TYPE
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS
from skiros2_runs.core.task_run import TaskRun

#: The code of a preempted skill, and of one that did not start.
_PREEMPTED = -1

_STAGES = {"pre": "pre-condition", "hold": "hold-condition", "post": "post-condition"}


@dataclass
class Outcomes:
    """How often something ended in each way: a node, or the evaluation of a condition."""

    good: int = 0
    bad: int = 0
    preempted: int = 0

    @property
    def is_covered(self) -> bool:
        """Whether it was seen to succeed and to fail."""
        return self.good > 0 and self.bad > 0


@dataclass
class SkillCoverage:
    """What runs have exercised of one implementation.

    :param outcomes: of the skill.
    :param conditions: by stage and label, as in `post-condition GripperFull`; good: it held.
    :param branches: of the nodes below it that do not belong to another skill, by the names on the way; () for a skill
        without children.
    """

    label: str
    outcomes: Outcomes = field(default_factory=Outcomes)
    conditions: dict[str, Outcomes] = field(default_factory=dict)
    branches: dict[tuple[str, ...], Outcomes] = field(default_factory=dict)

    @property
    def was_run(self) -> bool:
        return self.outcomes.good + self.outcomes.bad + self.outcomes.preempted > 0

    @property
    def gaps(self) -> int:
        """The number of outcomes that were not seen."""
        every = (self.outcomes, *self.conditions.values(), *self.branches.values())
        return sum((not each.good) + (not each.bad) for each in every)


class Coverage:
    """What several runs have exercised, by the label of the skill."""

    def __init__(self) -> None:
        self.skills: dict[str, SkillCoverage] = {}
        #: Whether a run has no evidence: then its conditions are unknown.
        self.lacks_evidence = False

    def skill(self, label: str) -> SkillCoverage:
        """Returns the coverage of a skill."""
        return self.skills.setdefault(label, SkillCoverage(label))

    def declare(self, label: str, conditions: Iterable[str]) -> None:
        """Adds a skill that runs may exercise.

        :param conditions: stage and label of each, as in `post-condition GripperFull`.
        """
        for condition in conditions:
            self.skill(label).conditions.setdefault(condition, Outcomes())
        self.skill(label)

    def add(self, run: Run) -> None:
        """Adds a recorded run.

        :raises BagError: the bag cannot be read.
        """
        tasks = run.tasks() if PROGRESS in run.topics.values() else []
        for label, conditions in _declared(run):
            self.declare(label, conditions)
        labels: dict[tuple[str, int], Mapping[str, str]] = {}
        for task in tasks:
            nodes = list(node_histories(task).values())
            labels[task.robot, task.task_id] = {".".join(map(str, n.index_path)): _name(n) for n in nodes}
            self._add_nodes(task, nodes)
        self.lacks_evidence |= bool(tasks) and not any(topic.endswith(f"/{EVIDENCE}") for topic in run.topics)
        for key, path, stage, condition, holds in _evidence(run):
            label = labels.get(key, {}).get(path, "")
            if label:
                name = f"{_STAGES[stage]} {condition}"
                outcomes = self.skill(label).conditions.setdefault(name, Outcomes())
                outcomes.good += holds
                outcomes.bad += not holds

    def _add_nodes(self, task: TaskRun, nodes: list[NodeHistory]) -> None:
        by_path = {node.index_path: node for node in nodes}
        for node in nodes:
            if not node.index_path:
                continue
            is_group = node.type == GROUP_TYPE
            if not is_group:
                _count(self.skill(_name(node)).outcomes, node)
            owner = node.index_path[:-1]
            names = [f"{node.index_path[-1] + 1} {node.name}"]
            while owner and by_path[owner].type == GROUP_TYPE:
                names.insert(0, f"{owner[-1] + 1} {by_path[owner].name}")
                owner = owner[:-1]
            if owner:
                branches = self.skill(_name(by_path[owner])).branches
                _count(branches.setdefault(tuple(names), Outcomes()), node)


def _name(node: NodeHistory) -> str:
    """Returns the label of a skill; without one, because it was never started, its type."""
    return node.label or node.name


def _count(outcomes: Outcomes, node: NodeHistory) -> None:
    before: int = IDLE
    for report in node.state_changes():
        if report.state == SUCCESS:
            outcomes.good += 1
        elif report.state == FAILURE and before == RUNNING and report.code == _PREEMPTED:
            outcomes.preempted += 1
        elif report.state == FAILURE:
            outcomes.bad += 1
        before = report.state


def _declared(run: Run) -> Iterator[tuple[str, list[str]]]:
    """Yields the label and the conditions of each declared skill."""
    for topic, kind in run.topics.items():
        if kind == "std_msgs/String" and topic.endswith(f"/{DECLARATIONS}"):
            for message in run.messages(topic):
                for skill in _json(topic, message.content.data)["skills"]:
                    yield (
                        skill["label"],
                        [part for part in skill["declares"] if part.startswith(tuple(_STAGES.values()))],
                    )


def _evidence(run: Run) -> Iterator[tuple[tuple[str, int], str, str, str, bool]]:
    """Yields robot and task, node path, stage, label and result of each evaluated condition."""
    for topic, kind in run.topics.items():
        if kind == "std_msgs/String" and topic.endswith(f"/{EVIDENCE}"):
            robot = topic.removesuffix(f"/{EVIDENCE}")
            for message in run.messages(topic):
                found = _json(topic, message.content.data)
                for path, stage, name, value in found["entries"]:
                    if stage in _STAGES:
                        yield (robot, found["task"]), path, stage, name, bool(value)


def _json(topic: str, text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BagError(f"{topic}: expected JSON: {error}") from error
    if not isinstance(found, dict):
        raise BagError(f"{topic}: expected a JSON object")
    return found
