"""The robots with an active stop, and their recovery."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from skiros2_gui.app.events import ConnectionChanged, ManagersChanged, TasksChanged
from skiros2_gui.app.skill_calls import SkillCalls
from skiros2_gui.app.system import MANAGER, parts_of
from skiros2_gui.app.window import Window

#: The skill that clears a stop.
RECOVERY = "skiros:RecoverFromStop"


@dataclass(frozen=True)
class StoppedRobot:
    """:param manager: the node name of its manager.
    :param kind: such as "emergency stop".
    :param text: since when, and the reasons.
    :param failure: why the last recovery failed; "" if it has not.
    :param obstacle: why no recovery can be started; "" if it can.
    """

    manager: str
    kind: str
    text: str
    failure: str
    obstacle: str


class Stops:
    """Used in the window's thread.

    :param on_change: called when `robots` may have changed.
    """

    def __init__(self, window: Window, on_change: Callable[[], None]) -> None:
        self._window = window
        self._calls = SkillCalls(window, on_change)
        for kind in (ConnectionChanged, ManagersChanged, TasksChanged):
            window.subscribe(kind, lambda _: on_change())

    @property
    def robots(self) -> list[StoppedRobot]:
        """The robots with an active stop."""
        return [
            StoppedRobot(
                part.name,
                part.stop,
                part.text,
                self._calls.failure(part.name, RECOVERY),
                self._calls.obstacle(part.name, RECOVERY),
            )
            for part in parts_of(self._window.tasks.cell)
            if part.kind == MANAGER and part.is_up and part.stop
        ]

    def recover(self, manager: str) -> None:
        """Starts the recovery of a robot."""
        self._calls.start(manager, RECOVERY, {})
