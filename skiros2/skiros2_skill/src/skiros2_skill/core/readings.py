"""What running nodes have read (parameters above, elements, hold-conditions), and reading again what has changed."""

from __future__ import annotations

import logging
from typing import Any

from skiros2_common.core.conditions import (
    AbstractConditionRelation,
    ConditionFunction,
    ConditionGenerate,
    ConditionHasProperty,
    ConditionIsSpecified,
    ConditionOnType,
    ConditionOr,
    ConditionProperty,
    ConditionRelation,
)
from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import HOLD, PARAMETER
from skiros2_common.core.revision import local_revision
from skiros2_skill.core.blackboard import is_removed, refresh, removal
from skiros2_skill.core.failures import HOLD_FAILED, Failure, unmet
from skiros2_skill.core.inside import Inside
from skiros2_skill.core.wrapper import SkillWrapper

log = logging.getLogger(__name__)

#: Conditions whose fact follows from the ontologies and the elements in their parameters. Not those derived from them.
_OF_THEIR_ELEMENTS = (
    AbstractConditionRelation,
    ConditionGenerate,
    ConditionHasProperty,
    ConditionIsSpecified,
    ConditionOnType,
    ConditionProperty,
    ConditionRelation,
)


class Watch:
    """What a node has read, as marks of the world model's `Revisions`.

    :param ontology: what the ontologies said.
    :param elements: each id with what stood for its element.
    """

    __slots__ = ("elements", "ontology")

    def __init__(self, ontology: object, elements: list[tuple[str, object]]) -> None:
        self.ontology = ontology
        self.elements = elements

    def is_same(self, present: Any) -> bool:
        """Whether nothing of it has changed."""
        if present is None or present.ontology is not self.ontology:
            return False
        element = present.element
        for eid, seen in self.elements:  # noqa: SIM110 - all() takes twice the time
            if element(eid) is not seen:
                return False
        return True


class Readings:
    """Keeps what the running nodes of a task have read up to date. For the thread that ticks the task.

    `stamp` counts the changes of the task's parameters and of the world model. A node that has read at the present
    stamp has nothing to read; at another one, it reads again what has changed of what it had read.

    :param wmi: the world model as the task sees it.
    :param inside: where it is noted that the world model is being asked for a node.
    """

    def __init__(self, wmi: Any, inside: Inside) -> None:
        self._wmi = wmi
        self._inside = inside
        self.board: Any = None  # the task's blackboard, once it is ticked
        self.stamp = 0
        self._params_stamp = 0  # of the last change of a parameter
        self.mark = -1  # of the last look; -1 when there is something to look at each time
        self.version = -1  # of the world model, as it was looked at last
        self._present: Any = None
        self._present_version = -1

    @property
    def are_up_to_date(self) -> bool:
        """Whether nothing has changed in the world model since it was looked at last. Any thread."""
        return self._wmi is None or (self.version != -1 and self._wmi.version == self.version)

    def look(self) -> None:
        """Takes note of a change of the world model."""
        mark = local_revision.current
        if mark == self.mark:
            return
        version = self._wmi.version if self._wmi is not None else 0
        self.mark = mark if version != -1 else -1
        if version != self.version or version == -1:
            self.version = version
            self.stamp += 1

    def note_parameter(self) -> None:
        """A parameter of a node above has changed."""
        self.stamp += 1
        self._params_stamp = self.stamp

    def begin(self, node: SkillWrapper, stamp: int) -> None:
        """A node starts.

        :param stamp: when its parameters were read; they are read again when something has changed since.
        """
        node.volatile = any(_is_volatile(c, self._wmi) for c in node._hold_conditions)
        node.watch = None
        node.seen_stamp = -1 if node._hold_conditions else stamp

    def renew(self, node: SkillWrapper) -> Failure | None:
        """Before a running node is ticked: its parameters and hold-conditions. The failure when one does not hold."""
        if node.seen_stamp == self.stamp:
            return self._unmet(node) if node.volatile else None
        stamp = self.stamp
        try:
            taken = node.seen_stamp < self._params_stamp and self.board.pull(node, node.slots)
            present = self.present(node)
            if taken or node.watch is None or not node.watch.is_same(present):
                # What stands for the elements is noted before they are read: what changes in between is read again.
                node.watch = _watch(node, present)
                gone = self._refresh(node, present)
                if gone and not node.is_compound:  # a compound's children see to what they need
                    text = f"{removal(gone[0], self._wmi)}, while {node.label} was running with it"
                    return Failure(PARAMETER, HOLD_FAILED, text)
                failure = self._unmet(node)
            else:
                failure = self._unmet(node) if node.volatile else None
        except SkirosError as error:
            return Failure(PARAMETER, HOLD_FAILED, str(error))
        if failure is None:
            node.seen_stamp = stamp
        return failure

    def pull(self, node: SkillWrapper) -> None:
        """Parameters and elements of a node as they are now; elements that are gone are dropped.

        :raises WmException: the world model does not answer.
        """
        if node.seen_stamp != self.stamp:
            self.board.pull(node, node.slots)
            self._refresh(node, self.present(node))
            node.watch = None

    def pull_if_possible(self, node: SkillWrapper) -> None:
        """As `pull`; when the world model does not answer, the node keeps what it has."""
        self.look()
        try:
            self.pull(node)
        except SkirosError as error:
            log.debug("%s keeps the parameters that it has: %s", node.printState(), error)

    def drop_gone(self, node: SkillWrapper) -> None:
        """Drops the elements of a node that it has removed itself, or that nodes below it have.

        :raises WmException: the world model does not answer.
        """
        present = self.present(node)
        if present is None:
            self._refresh(node, None)
            return
        for slot in node.element_slots:
            values = slot.param._values
            there = [e for e in values if (present.element(e.id) is not None if e.id else not is_removed(e))]
            if len(there) < len(values):
                slot.param._values = there
                slot.seen = None

    def _refresh(self, node: SkillWrapper, present: Any) -> list[str]:
        what = "the reading of its elements"
        return self._inside.call(node, what, refresh, node.element_slots, self._wmi, present)

    def _unmet(self, node: SkillWrapper) -> Failure | None:
        if not node._hold_conditions:
            return None
        return self._inside.call(node, "its conditions", unmet, HOLD, node._hold_conditions, node._params, self._wmi)

    def present(self, node: SkillWrapper) -> Any:
        """The world model's `Revisions`; it is asked for once for each version, for whichever node comes first.

        :raises WmException: the world model does not answer.
        """
        if self._present_version != self.version or self.version == -1:
            self._present = None
            if self._wmi is not None:
                self._present = self._inside.call(node, "the reading of its elements", self._wmi.revisions)
            self._present_version = self.version
        return self._present


def _watch(node: SkillWrapper, present: Any) -> Watch | None:
    """What a node is about to read; None when its conditions may depend on more than its elements."""
    if present is None or not all(_is_of_elements(c, node._params._params) for c in node._hold_conditions):
        return None
    ids = [value.id for slot in node.element_slots for value in slot.param._values if value.id]
    return Watch(present.ontology, [(eid, present.element(eid)) for eid in ids])


def _is_of_elements(condition: Any, params: dict[str, Any]) -> bool:
    """Whether a condition need not be evaluated again while parameters, their elements and the ontologies stay."""
    if condition.volatile:
        return True  # it is at each tick
    if type(condition) is ConditionOr:
        return all(_is_of_elements(part, params) for part in condition.conditions)
    # An unset parameter may stand for any element of a class.
    return type(condition) in _OF_THEIR_ELEMENTS and all(
        key in params and params[key].is_bound() for key in condition.getKeys()
    )


def _is_volatile(condition: Any, wmi: Any) -> bool:
    relation = getattr(condition, "relation", None)
    if condition.volatile or isinstance(condition, ConditionFunction):  # a dict may change in place
        return True
    return relation is not None and reasoners.find_or_load(relation) is not None
