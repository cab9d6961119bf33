"""Synthetic progress messages of tasks."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from skiros2_runs.core.progress import status_text
from skiros2_runs.core.states import FAILURE, IDLE, RUNNING, SUCCESS, TaskState

__all__ = ["FAILURE", "IDLE", "RUNNING", "SUCCESS", "ProgressNode", "fresh", "pick_and_place", "random_tree", "root"]


@dataclass
class ProgressNode:
    """A node, with the fields of `SkillProgress` that matter for a tree."""

    id: int
    parent_id: int
    label: str = ""
    type: str = "skiros:Work"
    processor: str = ""
    state: int = IDLE
    progress_code: int = 0
    progress_time: float = 0.0
    progress_message: str = ""
    robot: str = "/robot"
    task_id: int = 5
    params: Sequence[Any] = ()


def root(
    task_id: int = 5, state: int = RUNNING, code: int = 0, message: str = "", status: TaskState | None = None
) -> ProgressNode:
    params = () if status is None else (SimpleNamespace(param=status_text(status)),)
    return ProgressNode(task_id, -1, "root", ":Root", "->*", state, code, 0.0, message, task_id=task_id, params=params)


def pick_and_place(pick: int = RUNNING, place: int = IDLE, task_id: int = 5, **of_root: object) -> list[ProgressNode]:
    """A task of two skills, one of which is made of two others."""
    nodes = [
        root(task_id, **of_root),  # type: ignore[arg-type]
        ProgressNode(100, task_id, "pick", "skiros:Pick", "->*", pick),
        ProgressNode(101, 100, "move_arm", "skiros:MoveArm", state=pick),
        ProgressNode(102, 100, "close_gripper", "skiros:CloseGripper"),
        ProgressNode(200, task_id, "place", "skiros:Place", state=place),
    ]
    for node in nodes:
        node.task_id = task_id
    return nodes


def fresh(nodes: list[ProgressNode]) -> list[ProgressNode]:
    """A copy of the message with new objects."""
    return [replace(node) for node in nodes]


def random_tree(count: int, seed: int = 1) -> list[ProgressNode]:
    """A wide and deep tree with the given number of nodes."""
    chance = random.Random(seed)
    nodes = [root()]
    for number in range(1, count):
        above = nodes[chance.randrange(max(0, number - 40), number)]
        nodes.append(ProgressNode(1000 + number, above.id, f"skill_{number}"))
    return nodes
