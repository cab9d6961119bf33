"""Names of skill managers. Node names have a leading slash; names in scenes may lack it."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_common.core.world_element import Element

#: The property of a robot that names its manager.
SKILL_MGR = "skiros:SkillMgr"


def bare_name(name: str) -> str:
    """The last part of a node name, as used in scenes: `robot` for `/robot`."""
    return name.rpartition("/")[2]


def manager_of(robot: Element) -> str:
    """The node name of the manager that a robot's element names; "" when it names none."""
    name = robot.value_of(SKILL_MGR) if robot.hasProperty(SKILL_MGR, not_none=True) else None
    return f"/{str(name).lstrip('/')}" if name else ""


def same_node(one: str, other: str) -> bool:
    """Whether two names denote the same ROS node. A name without a leading slash may be the last part of the full name.

    Scenes name skill managers in both forms.
    """
    if one.startswith("/") == other.startswith("/"):
        return one == other
    full, last = (one, other) if one.startswith("/") else (other, one)
    return bool(last) and full.endswith(f"/{last}")


def runs_on(robot: Element, manager: str) -> bool:
    """Whether a robot's element names this manager, with or without slash."""
    return bool(manager) and matching_name(manager_of(robot), [manager]) == manager


def matching_name(name: str, nodes: Iterable[str]) -> str:
    """The node that a name refers to: by its full name, with or without slash, or by its last part; "" for none."""
    nodes = list(nodes)
    wanted = f"/{name.lstrip('/')}"
    return wanted if wanted in nodes else next((node for node in nodes if same_node(name.strip("/"), node)), "")
