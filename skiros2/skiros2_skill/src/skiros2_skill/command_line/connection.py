"""The services of a running skill manager, for commands."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import rosgraph

from skiros2_common.command_line.command import Unavailable, UsageError
from skiros2_common.command_line.master import ask_master, check_node
from skiros2_common.core.errors import Refused, UnknownName
from skiros2_common.core.names import nearest
from skiros2_skill.command_line.description import Skill, read_skill

if TYPE_CHECKING:
    from skiros2_skill.core.diagnosis.inspection import NodeStatus

_SKILLS, _COMMAND = "get_skills", "command"


def connect(robot: str, author: str) -> Manager:
    """Connects to a running skill manager.

    :param robot: its node name, with or without the leading slash; "": the only one.
    :param author: named in its log.
    :raises Unavailable: no manager answers; determined within seconds.
    :raises UsageError: there are several, and `robot` is empty.
    """
    return Manager(find_manager(robot), author)


def find_manager(robot: str) -> str:
    """The node name of the skill manager; arguments and errors as in `connect`."""
    registered = _registered()
    if robot:
        name = _resolved(robot, registered)
        check_node(name, _SKILLS, "skill manager")
        return name
    alive = [name for name in registered if _answers(name)]
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


def _answers(manager: str) -> bool:
    try:
        check_node(manager, _SKILLS, "skill manager")
    except Unavailable:
        return False
    return True


class Manager:
    """A client of a manager's services. Each call raises `WmException` when the manager refuses.

    :param name: its node name.
    :param author: named in its log.
    """

    def __init__(self, name: str, author: str) -> None:
        self.name = name
        self.author = author

    def skills(self) -> list[Skill]:
        """The skills of the manager. Waits until they are loaded."""
        from skiros2_msgs import srv as srvs

        answer = self._call(_SKILLS, srvs.ResourceGetDescriptions)
        return [read_skill(s.type, s.name, [p.param for p in s.params]) for s in answer.list]

    def command(self, action: str, task_id: int, skills: Sequence[Any] = ()) -> int:
        """Starts, pauses, resumes, preempts or ticks tasks; see `SkillCommand`. Returns the task id.

        :param skills: of a new task, `ResourceDescription` messages.
        """
        from skiros2_msgs import srv as srvs

        answer = self._call(_COMMAND, srvs.SkillCommand, self.author, action, task_id, list(skills))
        return int(answer.execution_id)

    def tasks(self, task_id: int = -1) -> list[Sequence[Any]]:
        """The tasks that have not ended, by id: the `SkillProgress` of each node, parents before children.

        :param task_id: of one task; -1: all.
        """
        from skiros2_msgs import srv as srvs

        trees = self._call("tasks", srvs.SkillTasks, task_id).tasks
        return sorted((tree.progress for tree in trees), key=lambda nodes: nodes[0].id)

    def why(self, task_id: int) -> Any:
        """Why a task failed: a `SkillWhyResponse`."""
        from skiros2_msgs import srv as srvs

        return self._call("why", srvs.SkillWhy, task_id)

    def inspect(self, task_id: int, node_id: int) -> NodeStatus:
        """Inspects a node of a task that has not ended: its parameters, and whether its conditions hold.

        :raises UnknownName: there is no such task or node.
        """
        from skiros2_msgs import srv as srvs
        from skiros2_skill.core.diagnosis.inspection import NodeStatus

        answer = self._call("inspect", srvs.SkillInspection, task_id, node_id)
        if not answer.ok:
            raise UnknownName(f"{self.name}: {answer.text}")
        return NodeStatus.from_json(answer.json)

    def breakpoint(self, action: str, kind: str = "", pattern: str = "", when: str = "", number: int = 0) -> Any:
        """Adds, removes or lists breakpoints. Returns the number and all breakpoints."""
        from skiros2_msgs import srv as srvs

        answer = self._call("breakpoint", srvs.SkillBreakpoint, action, kind, pattern, when, number)
        return answer.number, json.loads(answer.json or "[]")

    def reload(self, libraries: Sequence[str]) -> str:
        """Reloads libraries; none: all. Returns the manager's message.

        :raises Refused: the reload has failed.
        """
        from skiros2_msgs import srv as srvs

        answer = self._call("reload", srvs.SkillReload, list(libraries))
        if not answer.ok:
            raise Refused(f"{self.name}: {answer.text}")
        return str(answer.text)

    def is_alive(self) -> bool:
        """Whether the manager still answers."""
        return _answers(self.name)

    def _call(self, service: str, kind: Any, *arguments: Any) -> Any:
        from skiros2_world_model.ros.service_pool import ServicePool  # rospy takes a quarter of a second

        pool = ServicePool(f"{self.name}/{service}", kind, 0.0)
        try:
            return pool.call(kind._request_class(*arguments), repeatable=False)
        finally:
            pool.close()
