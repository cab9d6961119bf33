"""Where contact skills get their arms from: ROS, or a source that a test or a study provides.

An arm serves one skill at a time, in the process of its skill manager; `ParamOptions.Lock` keeps other managers away.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol, runtime_checkable

from skiros2_common.core.errors import Refused
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.compliant_arm import CompliantArm


class ArmSource(Protocol):
    """Connects elements of the world model to arms."""

    def arm(self, wmi: WorldModelPort, robot: Element, arm: Element) -> CompliantArm:
        """Returns the arm of an element. Does not block.

        :raises SkirosError: there is no driver for it.
        """
        ...


@runtime_checkable
class FingerSource(Protocol):
    """A source of arms that also knows the fingers of their grippers."""

    def width(self, wmi: WorldModelPort, robot: Element, gripper: Element) -> float | None:
        """Returns the measured distance between the fingers (m); None if it is not measured. Does not block."""
        ...


_provided: list[ArmSource] = []
_users: dict[str, object] = {}
_lock = threading.Lock()


@contextmanager
def provided_arms(source: ArmSource) -> Iterator[None]:
    """Makes skills of this process use the arms of a source inside the `with` block."""
    _provided.append(source)
    with _lock:
        before = dict(_users)
        _users.clear()
    try:
        yield
    finally:
        _provided.remove(source)
        with _lock:
            _users.clear()
            _users.update(before)


def take_arm(wmi: WorldModelPort, robot: Element, arm: Element, user: object) -> CompliantArm:
    """Returns an arm for exclusive use until `give_back`.

    :param user: the skill.
    :raises Refused: another skill of this process uses the arm.
    :raises SkirosError: there is no driver for it.
    """
    found = _source().arm(wmi, robot, arm)
    with _lock:
        if _users.setdefault(arm.id, user) is not user:
            raise Refused(f"arm {arm.label or arm.id} is used by another skill: {_users[arm.id]}")
    return found


def finger_width(wmi: WorldModelPort, robot: Element, gripper: Element) -> float | None:
    """Returns the measured distance between the fingers of a gripper (m); None if it is not measured."""
    source = _source()
    return source.width(wmi, robot, gripper) if isinstance(source, FingerSource) else None


def give_back(user: object) -> None:
    """Ends the exclusive use of arms by a skill."""
    with _lock:
        for arm in [arm for arm, current in _users.items() if current is user]:
            del _users[arm]


def _source() -> ArmSource:
    if _provided:
        return _provided[-1]
    # in a ROS node only: tests and studies need no ROS
    from skiros2_contact_skills.ros.arm_source import ROS_ARMS

    return ROS_ARMS
