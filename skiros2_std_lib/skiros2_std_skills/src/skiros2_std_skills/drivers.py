"""Base classes of primitives that use a driver of the robot."""

from __future__ import annotations

from typing import Any

import actionlib

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_std_skills.service_client_primitive import PrimitiveServiceClient

#: Progress code: the world model lacks data for the goal or request.
NOT_KNOWN = -110


class _Parameters:
    """Access to parameter values."""

    params: ParamHandler

    def element(self, key: str) -> Element:
        """Returns the element in a parameter."""
        value: Element = self.params[key].value
        return value

    def value(self, key: str) -> Any:
        """Returns the value of a parameter."""
        return self.params[key].value

    def label_of(self, key: str) -> str:
        """Returns the name of the element in a parameter."""
        element = self.element(key)
        return str(element.label or element.id)


class DriverAction(_Parameters, PrimitiveActionClient):
    """Base of the primitives that send one goal to an action. Missing data in the world model is a failure with a
    reason, without traceback."""

    def address(self) -> tuple[str, type]:
        """To override: returns name and type of the action."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define address")

    def doing(self) -> str:
        """To override: returns what the motion does, for progress messages."""
        return str(self.label)

    def buildClient(self) -> actionlib.SimpleActionClient:
        return self.make_client(*self.address())

    def make_client(self, name: str, kind: type) -> actionlib.SimpleActionClient:
        """Returns a client of an action."""
        return actionlib.SimpleActionClient(name, kind)

    def onStart(self) -> bool:
        try:
            return super().onStart()
        except SkirosError as error:
            return self.startError(f"{self.doing()}: {error}", NOT_KNOWN)

    def failed(self, reason: str, code: int, kind: FailureKind = FailureKind.RETRYABLE) -> State:
        """Fails with a reason. `kind`: whether the motion may be tried again."""
        return self.fail(f"{self.doing()} failed: {reason}", code, kind)


class DriverService(_Parameters, PrimitiveServiceClient):
    """Base of the primitives that call a service."""

    build_client_onstart = True
    call_timeout_sec = 10.0

    def onStart(self) -> bool:
        try:
            return super().onStart()
        except SkirosError as error:
            return self.startError(str(error), NOT_KNOWN)
