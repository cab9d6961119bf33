"""A ROS master of its own with the nodes that a replay needs; this process is a node too."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import rospy

from skiros2_common.ros.private_system import PrivateSystem


class Lab(PrivateSystem):
    """A context manager; one in a process."""

    def __init__(self) -> None:
        super().__init__("replay", has_own_home=True)

    def set_parameters(self, values: Mapping[str, Any]) -> None:
        """Sets parameters of the master by full name."""
        for name, value in values.items():
            rospy.set_param(name, value)

    def node(self, package: str, program: str, name: str, parameters: Mapping[str, Any] | None = None) -> None:
        """Starts a node; does not wait for it.

        :param name: its full name.
        :param parameters: its private ones.
        """
        namespace, _, own = name.rpartition("/")
        self.set_parameters({f"{name}/{key}": value for key, value in (parameters or {}).items()})
        self.start(name, ["rosrun", package, program, f"__name:={own}", f"__ns:={namespace or '/'}"])
