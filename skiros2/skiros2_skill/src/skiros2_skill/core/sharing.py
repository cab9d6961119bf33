"""What becomes of the parameters of a skill that has run: elements are written, values go to the blackboard."""

from __future__ import annotations

import logging
import weakref
from typing import Any

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import Refused, SkirosError
from skiros2_skill.core.blackboard import assigned_elements, drop_changes, unwritten_elements
from skiros2_skill.core.readings import Readings
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)


class Sharing:
    """Of one task, for the thread that ticks it.

    :param wmi: the world model as the task sees it.
    """

    def __init__(self, wmi: Any, readings: Readings) -> None:
        self._wmi = wmi
        self._readings = readings
        self._told: weakref.WeakSet[Any] = weakref.WeakSet()  # elements that were changed in place, and logged

    def settle(self, node: SkillWrapper, state: State, version: int) -> None:
        """After an `execute`: writes the elements that the skill has assigned to its parameters, as one change, and
        drops those that it, or a node below it, has removed. While it runs, its values go to the blackboard.

        :param version: of the world model before the `execute`.
        :raises SkirosError: the world model refuses, or does not answer.
        """
        elements = assigned_elements(node.element_slots)
        if elements:
            node.watch = None
            try:
                self._wmi.update_elements(elements)
            except SkirosError as error:
                drop_changes(node.element_slots, self._wmi)
                raise Refused(f"the world model refused what the skill changed: {error}") from error
        if state is State.Running:
            self.share(node)
        self._readings.look()
        if self._readings.version != version:
            self._readings.drop_gone(node)

    def share(self, node: SkillWrapper, everything: bool = False, removes: bool = True) -> None:
        """Puts the parameters of a node on the blackboard; see `Blackboard.push`."""
        if self._readings.board.push(node, node.slots, everything, removes):
            self._readings.note_parameter()
        node.lent = [slot.param for slot in node.slots if slot.param.shared_snapshot is not None]
        if node.lent:
            node.steady_stamp = -1  # its lists have to be watched

    def tell_unwritten(self, node: SkillWrapper) -> None:
        """Tells an author of elements that were changed in place, which is not written."""
        changed = [e for e in unwritten_elements(node.element_slots) if e not in self._told]
        if changed:
            self._told.update(changed)
            log.debug(
                "%s succeeded; changed in place and not written to the world model: %s. "
                "To write it, assign the parameter or call update_element.",
                node.printState(), ", ".join(map(repr, changed)),
            )  # fmt: skip
