"""Finds a running skill manager for a command, without a node, and monitors its tasks as a node.

ROS is imported where it is used: other commands work without it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from skiros2_common.command_line.command import Unavailable, UsageError
from skiros2_common.command_line.master import ask_master, check_node, master_uri
from skiros2_common.core.names import nearest

if TYPE_CHECKING:
    from skiros2_skill.client.manager import ManagerClient

_SKILLS, _COMMAND = "get_skills", "command"


def connect(robot: str, author: str) -> ManagerClient:
    """Connects to a running skill manager.

    :param robot: its node name, with or without the leading slash; "": the only one.
    :param author: named in its log.
    :raises Unavailable: no manager answers; determined within seconds.
    :raises UsageError: there are several, and `robot` is empty.
    """
    name = find_manager(robot)
    from skiros2_skill.client.manager import ManagerClient

    return ManagerClient(name, author)


def find_manager(robot: str) -> str:
    """The node name of the skill manager; arguments and errors as in `connect`."""
    registered = registered_managers()
    if robot:
        name = _resolved(robot, registered)
        check_node(name, _SKILLS, "skill manager")
        return name
    alive = [name for name in registered if is_alive(name)]
    if len(alive) > 1:
        raise UsageError(f"there are {len(alive)} skill managers, {', '.join(alive)}: name one with --robot")
    if not alive:
        dead = f" that answers ({', '.join(registered)} may have been killed)" if registered else ""
        raise Unavailable(f"there is no skill manager{dead} on the master {master_uri()}")
    return alive[0]


def registered_managers() -> list[str]:
    """The node names of the registered skill managers, including killed ones."""
    _, _, services = ask_master("getSystemState")
    known = {name for name, _ in services}
    managers = [name.removesuffix(f"/{_SKILLS}") for name in known if name.endswith(f"/{_SKILLS}")]
    return sorted(name for name in managers if f"{name}/{_COMMAND}" in known)


def _resolved(robot: str, registered: list[str]) -> str:
    import rosgraph

    namespace = rosgraph.names.get_ros_namespace()
    for name in (rosgraph.names.ns_join(namespace, robot), f"/{robot}"):
        if name in registered:
            return name
    near = nearest(f"/{robot.lstrip('/')}", registered, 1)
    hint = f"did you mean {near[0]}?" if near else f"there are: {', '.join(registered) or 'none'}"
    raise Unavailable(f"there is no skill manager {robot} on the master {master_uri()}; {hint}")


def is_alive(manager: str) -> bool:
    """Whether a manager, given by node name, answers."""
    try:
        check_node(manager, _SKILLS, "skill manager")
    except Unavailable:
        return False
    return True


#: Time without messages after which the manager is checked (s).
_ALIVE_CHECK_PERIOD = 2.0


def become_node(name: str) -> None:
    """Makes this process a ROS node with a unique name; Ctrl-C stays a `KeyboardInterrupt`."""
    import rospy

    rospy.init_node(name, anonymous=True, disable_signals=True, disable_rosout=True)


class TaskMonitor:
    """Receives the progress of a manager's tasks from its creation on."""

    def __init__(self, manager: ManagerClient) -> None:
        self._manager = manager
        self._received = threading.Condition()
        self._messages: list[Any] = []
        self._received_at = time.monotonic()
        import rospy

        from skiros2_msgs.msg import TreeProgress

        self._subscriber = rospy.Subscriber(f"{manager.name}/monitor", TreeProgress, self._on_progress, queue_size=100)

    def close(self) -> None:
        self._subscriber.unregister()

    def receive(self, timeout: float) -> list[Sequence[Any]]:
        """The messages since the last call, in order: the nodes of a task each.

        :param timeout: s to wait for a message.
        :returns: [] after a timeout.
        :raises Unavailable: the manager has died.
        """
        with self._received:
            if not self._messages:
                self._received.wait(timeout)
            messages, self._messages = self._messages, []
        if not messages and time.monotonic() - self._received_at > _ALIVE_CHECK_PERIOD:
            if not is_alive(self._manager.name):
                raise Unavailable(f"the skill manager {self._manager.name} is gone")
            self._received_at = time.monotonic()
        return messages

    def _on_progress(self, message: Any) -> None:
        if message.progress:
            with self._received:
                self._messages.append(message.progress)
                self._received_at = time.monotonic()
                self._received.notify_all()
