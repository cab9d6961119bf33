"""Finds a running skill manager for a command, without a node."""

from __future__ import annotations

import rosgraph

from skiros2_common.command_line.command import Unavailable, UsageError
from skiros2_common.command_line.master import ask_master, check_node
from skiros2_common.core.names import nearest
from skiros2_skill.client.manager import ManagerClient

_SKILLS, _COMMAND = "get_skills", "command"


def connect(robot: str, author: str) -> ManagerClient:
    """Connects to a running skill manager.

    :param robot: its node name, with or without the leading slash; "": the only one.
    :param author: named in its log.
    :raises Unavailable: no manager answers; determined within seconds.
    :raises UsageError: there are several, and `robot` is empty.
    """
    return ManagerClient(find_manager(robot), author)


def find_manager(robot: str) -> str:
    """The node name of the skill manager; arguments and errors as in `connect`."""
    registered = _registered()
    if robot:
        name = _resolved(robot, registered)
        check_node(name, _SKILLS, "skill manager")
        return name
    alive = [name for name in registered if is_alive(name)]
    if len(alive) > 1:
        raise UsageError(f"there are {len(alive)} skill managers, {', '.join(alive)}: name one with --robot")
    if not alive:
        dead = f" that answers ({', '.join(registered)} may have been killed)" if registered else ""
        raise Unavailable(f"there is no skill manager{dead} on the master {rosgraph.get_master_uri()}")
    return alive[0]


def _registered() -> list[str]:
    """The node names of the registered skill managers, including killed ones."""
    _, _, services = ask_master("getSystemState")
    known = {name for name, _ in services}
    managers = [name.removesuffix(f"/{_SKILLS}") for name in known if name.endswith(f"/{_SKILLS}")]
    return sorted(name for name in managers if f"{name}/{_COMMAND}" in known)


def _resolved(robot: str, registered: list[str]) -> str:
    namespace = rosgraph.names.get_ros_namespace()
    for name in (rosgraph.names.ns_join(namespace, robot), f"/{robot}"):
        if name in registered:
            return name
    near = nearest(f"/{robot.lstrip('/')}", registered, 1)
    hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(registered) or 'none'}"
    raise Unavailable(f"there is no skill manager {robot} on the master {rosgraph.get_master_uri()}; {hint}")


def is_alive(manager: str) -> bool:
    """Whether a manager, given by node name, answers."""
    try:
        check_node(manager, _SKILLS, "skill manager")
    except Unavailable:
        return False
    return True
