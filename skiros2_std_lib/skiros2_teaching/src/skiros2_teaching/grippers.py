"""Where teaching skills get their grippers from: ROS, or a source that a test or a study provides."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_motion.core.gripper import Gripper


class GripperSource(Protocol):
    """Connects elements of the world model to grippers."""

    def gripper(self, robot: Element, arm: Element, gripper: Element) -> Gripper:
        """Returns the gripper of an element. Does not block.

        :raises SkirosError: there is no driver for it.
        """
        ...


_provided: list[GripperSource] = []


@contextmanager
def provided_grippers(source: GripperSource) -> Iterator[None]:
    """Makes skills of this process use the grippers of a source inside the `with` block."""
    _provided.append(source)
    try:
        yield
    finally:
        _provided.remove(source)


def gripper_of(wmi: WorldModelPort, robot: Element, arm: Element) -> Gripper | None:
    """Connects the gripper of an arm; None for an arm without one. The caller closes it.

    :raises SkirosError: there is no driver for it.
    """
    parts = (wmi.find_element(relation["dst"]) for relation in arm.getRelations("-1", "skiros:hasA"))
    found = next((e for e in parts if e is not None and wmi.is_subclass(e.type, "rparts:GripperEffector")), None)
    if found is None:
        return None
    if _provided:
        return _provided[-1].gripper(robot, arm, found)
    # in a ROS node only: tests and studies need no ROS
    from skiros2_teaching.ros.action_gripper import ActionGripper

    return ActionGripper.of(robot, arm, found)
