"""Where teleoperation gets its twists from: ROS, or a source that a test provides."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_teaching.core.teleoperation import TwistInput


class TwistSource(Protocol):
    """Connects arms to hand-held devices."""

    def twists(self, arm: Element) -> TwistInput:
        """Returns the input of an arm. Does not block."""
        ...


_provided: list[TwistSource] = []


@contextmanager
def provided_twists(source: TwistSource) -> Iterator[None]:
    """Makes skills of this process use the twists of a source inside the `with` block."""
    _provided.append(source)
    try:
        yield
    finally:
        _provided.remove(source)


def twists_of(wmi: WorldModelPort, robot: Element, arm: Element, topic: str) -> TwistInput:
    """Connects the device of an arm. The caller closes it.

    :param topic: its name in ROS; "" for the default one.
    """
    if _provided:
        return _provided[-1].twists(arm)
    # in a ROS node only: tests and studies need no ROS
    from skiros2_teaching.ros.twist_topic import TwistTopic

    return TwistTopic.of(wmi, robot, arm, topic)
