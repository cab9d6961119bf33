"""A condition: a fact about the world model, the parameters that it speaks of, and whether it has to hold."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongType
from skiros2_common.core.explanation import MAX_EXAMPLES, Change, Finding, NearMatch
from skiros2_common.core.names import ANY_TYPE, id_order
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.source_location import SourceLocation
from skiros2_common.core.world_element import Element


class ConditionBase:
    """A condition on one parameter. Subclasses define `holds`, the fact, and how to make it so.

    :param clabel: the condition's label, for people.
    :param subj: key of the parameter.
    :param desired_state: whether the fact has to hold or not to hold.
    """

    #: Where it was added to a skill; None: not known.
    place: SourceLocation | None = None

    #: Whether it is for planners alone, and not checked.
    only_exported = False

    #: Whether the fact may change without a change of the world model or of a parameter.
    volatile = False

    def __init__(self, clabel: str, subj: str, desired_state: bool) -> None:
        self._label = clabel
        self._subject_key = subj
        self._desired_state = desired_state
        self._given_description = ""
        self._checked: dict[str, Any] = {}  # key -> its value at the last evaluation
        self._undo: list[Callable[[], None]] = []

    def __eq__(self, other: object) -> bool:
        return self.isEqual(other)

    __hash__ = object.__hash__  # remaps change what is equal, so a set or dict keeps equal conditions apart

    @property
    def label(self) -> str:
        return self._label

    @property
    def _description(self) -> str:
        # The text of `getDescription` without the label; libraries read it, and their own conditions assign it.
        return self._given_description or f"{'' if self._desired_state else 'not '}{self.fact()}"

    @_description.setter
    def _description(self, text: str) -> None:
        self._given_description = text

    @property
    def desired_state(self) -> bool:
        return self._desired_state

    # -- what subclasses define --------------------------------------------------------------------------------

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        """Whether the fact holds, whatever the desired state."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define holds")

    def fact(self) -> str:
        """The fact in words, with what the parameters were at the last evaluation."""
        return f"{self.__class__.__name__}({', '.join(self.getKeys())})"

    def _signature(self) -> tuple[Any, ...]:
        """All that makes two conditions of this class speak of the same fact."""
        return (self._subject_key,)

    # -- the contract's interface ------------------------------------------------------------------------------

    def evaluate(self, ph: ParamHandler, wmi: Any) -> bool:
        """Whether the desired state holds."""
        for key in self.getKeys():
            self._remember(key, ph)
        return self.holds(ph, wmi) == self._desired_state

    def satisfied_for_inference(self, ph: ParamHandler, wmi: Any) -> bool:
        """Whether inference may set the parameters to what they are: as `evaluate`, where a condition says no more."""
        return self.evaluate(ph, wmi)

    def getDescription(self) -> str:
        """The condition with the elements that it was checked on last."""
        return f"[{self._label}] {self._description}"

    # -- why it does not hold ----------------------------------------------------------------------------------

    def explain(self, ph: ParamHandler, wmi: Any) -> Finding:
        """What is to say when `evaluate` has answered False. Searches the scene for elements that would do.

        :raises SkirosError: as `evaluate`.
        """
        for key in self.getKeys():
            self._remember(key, ph)
        return Finding(
            self.__class__.__name__,
            self._label,
            {key: self._name(key) for key in self.getKeys()},
            self.expected(),
            self.found(ph, wmi) or "it does not hold",
            self._nearest(ph, wmi),
            self._changes(ph, wmi),
        )

    def expected(self) -> str:
        """What should be so, in words that follow on those of `found`."""
        return self.getDescription().removeprefix(f"[{self._label}] ")

    def found(self, ph: ParamHandler, wmi: Any) -> str:
        """What is so, when `evaluate` has answered False; "" when no more is known."""
        return ""

    def filter_text(self, key: str, ph: ParamHandler) -> str:
        """The condition in words that follow on a number of elements that a parameter may be."""
        return f"for which [{self._label}] holds"

    def found_for(self, key: str, ph: ParamHandler, wmi: Any) -> str:
        """As `found`, of the element in one parameter, without its name."""
        return self.found(ph, wmi).removeprefix(self._name(key)).lstrip(": ")

    def _nearest(self, ph: ParamHandler, wmi: Any) -> list[NearMatch]:
        """Elements of which it would hold, at most `MAX_EXAMPLES`."""
        return []

    def _changes(self, ph: ParamHandler, wmi: Any) -> list[Change]:
        """What of the scene it depends on, whoever changed it."""
        return []

    # -- effects and other forms -------------------------------------------------------------------------------

    def remap(self, initial_key: str, target_key: str) -> None:
        """Renames a parameter key."""
        if self._subject_key == initial_key:
            self._subject_key = target_key

    def getParamId(self, key: str) -> str:
        """The id that the element in a parameter had at the last evaluation, "" when it had none."""
        value = self._checked.get(key)
        return value.id if isinstance(value, Element) else ""

    def getKeys(self) -> list[str]:
        """The keys of the parameters it speaks of."""
        return [self._subject_key]

    def isEqual(self, other: Any) -> bool:
        """Whether `other` is the same condition, with the same desired state."""
        return self._same_fact(other) and bool(self._desired_state == other._desired_state)

    def hasConflict(self, other: Any) -> bool:
        """Whether both cannot hold: the same fact with the other desired state."""
        return self._same_fact(other) and bool(self._desired_state != other._desired_state)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        """Applies the effect to the elements in the parameters. False where that is not possible."""
        return False

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        """Applies the effect to the world model, as simulation does. False where that is not possible."""
        return self.evaluate(ph, wmi)

    def revert(self, ph: ParamHandler | None = None, wmi: Any = None) -> None:
        """Takes back what `setTrue` changed."""
        while self._undo:
            self._undo.pop()()

    def toElement(self) -> Element:
        """The condition as an element of the world model."""
        element = Element(f"skiros:{self.__class__.__name__}", self._label)
        element.setProperty("skiros:hasSubject", self._subject_key)
        element.setProperty("skiros:desiredState", self._desired_state)
        return element

    def copy(self) -> Any:
        """A copy, to be remapped and evaluated on its own."""
        copy = self.__class__.__new__(self.__class__)
        copy.__dict__.update(self.__dict__)
        copy._checked, copy._undo = {}, []
        return copy

    # -- shared by subclasses ----------------------------------------------------------------------------------

    def _same_fact(self, other: Any) -> bool:
        return type(self) is type(other) and self._signature() == other._signature()

    def _remember(self, key: str, ph: ParamHandler) -> None:
        param = ph._params.get(key)
        self._checked[key] = param._values[0] if param is not None and param._values else None

    def _name(self, key: str) -> str:
        value = self._checked.get(key, key)
        if isinstance(value, Element):
            return repr(value) if value.id else f"any {value!r}".rstrip("-")
        return f"{key} (unset)" if value is None else str(value)

    def _param_value(self, key: str, ph: ParamHandler) -> Any:
        """The parameter's value.

        :raises UnknownName: the skill has no such parameter.
        """
        param = ph._params.get(key)
        if param is None:
            raise UnknownName(f"condition {self._label!r} speaks of {key!r}; the skill has: {', '.join(ph.keys())}")
        return param.value

    def _element(self, key: str, ph: ParamHandler, wmi: Any) -> Element | None:
        """The element in a parameter; None when the parameter is unset or the world model has the element no more.

        Changes that are not written count: an element without any is as the world model has it now.

        :raises UnknownName: the skill has no such parameter.
        :raises WrongType: the parameter holds something else.
        """
        value = self._given(key, ph)
        if value is None or value.isAbstract() or not can_find_elements(wmi) or _is_changed(value):
            return value
        found: Element | None = wmi.refreshed(value) if hasattr(wmi, "refreshed") else wmi.find_element(value.id)
        return found

    def _given(self, key: str, ph: ParamHandler) -> Element | None:
        """The element in a parameter as it was read; raises as `_element`."""
        value = self._param_value(key, ph)
        if value is not None and not isinstance(value, Element):
            raise WrongType(f"condition {self._label!r}: parameter {key!r} is {value!r}, expected an element")
        return value

    def _lacking(self, key: str, ph: ParamHandler, wmi: Any) -> str:
        """Why a parameter holds no element of the scene, in words; "" when it holds one."""
        value = self._param_value(key, ph)
        if value is None:
            return f"parameter {key!r} is unset"
        if not isinstance(value, Element):
            return f"parameter {key!r} is {value!r}"
        if value.isAbstract():
            return f"parameter {key!r} is {self._name(key)}"
        return "" if is_in_scene(value, wmi) else f"{value!r} is not in the scene"

    def _others(
        self,
        key: str,
        ph: ParamHandler,
        wmi: Any,
        having: tuple[str, Any] | None = None,
        ids: Iterable[str] | None = None,
    ) -> Iterator[Element]:
        """The elements of the scene that a parameter could hold instead, ordered by id.

        :param having: a property and a value: only those that have it.
        :param ids: only those of these.
        """
        param = ph._params.get(key)
        if param is None or not param.is_element:
            return
        wanted = Element(param.element_type)
        if having is not None:
            wanted.setProperty(*having)
        if ids is None:
            found = wmi.resolve_elements(wanted)
        else:
            known = (wmi.find_element(eid) for eid in set(ids))
            found = [e for e in known if e is not None and (wanted.type in ANY_TYPE or e.isInstance(wanted, wmi))]
        present = {value.id for value in param.values}
        for element in sorted(found, key=lambda e: id_order(e.id)):
            if element.id not in present:
                yield element

    def _last(self, key: str, name: str, ph: ParamHandler, wmi: Any) -> list[Change]:
        """The last change of a property or relation of the element in a parameter; who made it is asked later."""
        value = self._param_value(key, ph)
        if not isinstance(value, Element) or value.isAbstract():
            return []
        return [Change(value.id, name if is_in_scene(value, wmi) else "")]


def can_find_elements(wmi: Any) -> bool:
    """Whether a world model tells what an element is now; those of libraries and tests need not."""
    return hasattr(type(wmi), "find_element")


def is_in_scene(element: Element, wmi: Any) -> bool:
    """Whether an element has an id, and the world model, if it tells, has the element."""
    return bool(element.id) and (not can_find_elements(wmi) or wmi.find_element(element.id) is not None)


def _is_changed(element: Element) -> bool:
    """Whether an element was made or changed here."""
    if not element.touched:
        return False
    changes = element.changes()
    return changes is None or bool(changes)


def near_matches(elements: Iterable[Element], why: str = "") -> list[NearMatch]:
    """The first of the elements, at most `MAX_EXAMPLES`."""
    return [NearMatch(repr(element), why) for element in islice(elements, MAX_EXAMPLES)]
