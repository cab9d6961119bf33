"""What running nodes have read (parameters above, elements, hold-conditions), and reading again what has changed."""

from __future__ import annotations

from typing import Any

from skiros2_common.core.conditions import (
    AbstractConditionRelation,
    ConditionGenerate,
    ConditionHasProperty,
    ConditionIsSpecified,
    ConditionOnType,
    ConditionOr,
    ConditionProperty,
    ConditionRelation,
)
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import HOLD, PARAMETER
from skiros2_common.core.mutations import mutations
from skiros2_skill.core import blackboard
from skiros2_skill.core.failures import HOLD_FAILED, Failure, unmet
from skiros2_skill.core.inside import Inside
from skiros2_skill.core.wrapper import SkillWrapper

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
    """What a node has read, as marks of the world model's `Present`.

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
        self.stamp = 0
        self._params_stamp = 0  # of the last change of a parameter
        self.mark = -1  # of the last look; -1 when there is something to look at each time
        self._version = -1
        self._present: Any = None
        self._present_version = -1

    @property
    def are_up_to_date(self) -> bool:
        """Whether nothing has changed in the world model since it was looked at last. Any thread."""
        return self._wmi is None or (self._version != -1 and self._wmi.version == self._version)

    def look(self) -> None:
        """Takes note of a change of the world model."""
        mark = mutations.mark
        if mark == self.mark:
            return
        version = self._wmi.version if self._wmi is not None else 0
        self.mark = mark if version != -1 else -1
        if version != self._version or version == -1:
            self._version = version
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
            taken = node.seen_stamp < self._params_stamp and blackboard.take(node, node.slots)
            present = self.present(node)
            if taken or node.watch is None or not node.watch.is_same(present):
                # What stands for the elements is noted before they are read: what changes in between is read again.
                node.watch = _watch(node, present)
                self._inside.call(node, "the reading of its elements", blackboard.renew, node.slots, self._wmi, present)
                failure = self._unmet(node)
            else:
                failure = self._unmet(node) if node.volatile else None
        except SkirosError as error:
            return Failure(PARAMETER, HOLD_FAILED, str(error))
        if failure is None:
            node.seen_stamp = stamp
        return failure

    def _unmet(self, node: SkillWrapper) -> Failure | None:
        if not node._hold_conditions:
            return None
        return self._inside.call(node, "its conditions", unmet, HOLD, node._hold_conditions, node._params, self._wmi)

    def present(self, node: SkillWrapper) -> Any:
        """The world model's `Present`; it is asked for once for each version, for whichever node comes first.

        :raises WmException: the world model does not answer.
        """
        if self._present_version != self._version or self._version == -1:
            self._present = None
            if self._wmi is not None:
                self._present = self._inside.call(node, "the reading of its elements", self._wmi.present)
            self._present_version = self._version
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
        key in params and params[key].isSpecified() for key in condition.getKeys()
    )


def _is_volatile(condition: Any, wmi: Any) -> bool:
    relation = getattr(condition, "relation", None)
    return condition.volatile or (relation is not None and wmi.get_reasoner(relation) is not None)
