"""What primitives share that have a driver of the robot do the work."""

from __future__ import annotations

from typing import Any

import actionlib

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.world_element import Element
from skiros2_std_skills.action_client_primitive import PrimitiveActionClient
from skiros2_std_skills.service_client_primitive import PrimitiveServiceClient

#: Progress code: the goal or the request could not be made from what the world model knows.
NOT_KNOWN = -110


class _Parameters:
    """Short ways to the values of the parameters."""

    params: Any

    def element(self, key: str) -> Element:
        """An element among the parameters."""
        value: Element = self.params[key].value
        return value

    def value(self, key: str) -> Any:
        """The value of another parameter."""
        return self.params[key].value

    def label_of(self, key: str) -> str:
        """What a person calls an element among the parameters."""
        element = self.element(key)
        return str(element.label or element.id)


class DriverAction(_Parameters, PrimitiveActionClient):
    """Base of the primitives that are one goal of an action. What the world model does not know fails with the reason,
    and not with a traceback."""

    def address(self) -> tuple[str, Any]:
        """To override: name and type of the action."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define address")

    def doing(self) -> str:
        """To override: what the motion does, for progress messages."""
        return str(self.label)

    def buildClient(self) -> Any:
        return actionlib.SimpleActionClient(*self.address())

    def onStart(self) -> bool:
        try:
            return super().onStart()
        except SkirosError as error:
            return self.startError(f"{self.doing()}: {error}", NOT_KNOWN)

    def failed(self, reason: str, code: int) -> State:
        """Fails with what it was about."""
        return self.fail(f"{self.doing()} failed: {reason}", code)


class DriverService(_Parameters, PrimitiveServiceClient):
    """Base of the primitives that are one call of a service."""

    build_client_onstart = True
    call_timeout_sec = 10.0

    def onStart(self) -> bool:
        try:
            return super().onStart()
        except SkirosError as error:
            return self.startError(str(error), NOT_KNOWN)
