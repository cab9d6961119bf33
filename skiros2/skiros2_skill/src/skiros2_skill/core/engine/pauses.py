"""Where one task pauses at breakpoints.

A tick that comes to one is broken off there, with nothing preempted; the next tick goes on at the same place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from skiros2_skill.core.engine.breakpoints import AT_END, BEFORE_START, Break, Breakpoints


class Pauses:
    """Looks for breakpoints in the course of a task's ticks. For the ticking thread.

    :param breakpoints: of all tasks; None: there are none.
    """

    def __init__(self, breakpoints: Breakpoints | None) -> None:
        self._breakpoints = breakpoints if breakpoints is not None else Breakpoints()
        self._reached = ""  # what has come to a breakpoint; the task pauses when its parents have taken note of it
        self._held: Any = None  # the node that was held back before its start

    def __bool__(self) -> bool:
        """Whether there is anything to look for."""
        return bool(self._reached or self._held is not None or self._breakpoints)

    def before(self, node: Any) -> None:
        """A node is to start.

        :raises Break: not before the task goes on.
        """
        if not self._reached and self._held is not node:
            self._reached = self._breakpoints.at_node(node, BEFORE_START)
            self._held = node if self._reached else None
        else:
            self._held = None
        self.at_end_of_tick()

    def after(self, node: Any) -> None:
        """A node has ended."""
        self._reached = self._reached or self._breakpoints.at_node(node, AT_END)

    def at_failure(self, conditions: Sequence[Any]) -> None:
        """These conditions do not hold."""
        for condition in conditions:
            self._reached = self._reached or self._breakpoints.at_condition(condition.label)

    def at_end_of_tick(self) -> None:
        """
        :raises Break: a breakpoint was reached.
        """
        reached, self._reached = self._reached, ""
        if reached:
            raise Break(reached)
