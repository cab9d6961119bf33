"""The controllers of a driver: which one is active, by the services of a controller manager."""

from __future__ import annotations

import time
from collections.abc import Mapping

from controller_manager_msgs.srv import ListControllers, SwitchController, SwitchControllerRequest
from skiros2_common.core.errors import Refused
from skiros2_contact_skills.ros.driver_calls import call

#: Period with which an active controller is looked for in the list (s of wall time): somebody else may have switched.
_PERIOD = 1.0


class Controllers:
    """The compliant controller of an arm and the one that it replaces. Methods but `is_due` block.

    :param switch, listing: names of the services.
    :param names: the names of both, `compliant` and `position`.
    """

    def __init__(self, switch: str, listing: str, names: Mapping[str, str]) -> None:
        self._switch, self._listing = switch, listing
        self._names = names["compliant"], names.get("position", "")
        self._checked_at: float | None = None  # s, monotonic; None: it is not active

    def activate(self) -> bool:
        """Switches to the compliant controller. Returns True.

        :raises Refused: it does not run then.
        """
        on, off = self._names
        answer = call(self._switch, SwitchController, [on], [off], SwitchControllerRequest.BEST_EFFORT, True, 0.0)
        listed = self._list()
        if not answer.ok or listed.get(on) != "running":
            known = ", ".join(f"{name} ({state})" for name, state in listed.items()) or "none"
            raise Refused(f"controller {on} does not run; {self._listing} lists: {known}")
        self._checked_at = time.monotonic()
        return True

    def is_due(self) -> bool:
        """Whether `is_active` is to be called: once in each period since `activate`."""
        now = time.monotonic()
        if self._checked_at is None or now - self._checked_at < _PERIOD:
            return False
        self._checked_at = now
        return True

    def is_active(self) -> bool:
        """Whether the compliant controller runs."""
        is_running = self._list().get(self._names[0]) == "running"
        if not is_running:
            self._checked_at = None
        return is_running

    def _list(self) -> dict[str, str]:
        return {each.name: each.state for each in call(self._listing, ListControllers).controller}
