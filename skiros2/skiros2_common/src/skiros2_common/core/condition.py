"""A condition: a fact about the world model, the parameters that it speaks of, and whether it has to hold."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongType
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element


class ConditionBase:
    """A condition on one parameter. Subclasses define `holds`, the fact, and how to make it so.

    :param clabel: the condition's label, for people.
    :param subj: key of the parameter.
    :param desired_state: whether the fact has to hold or not to hold.
    """

    #: Whether the fact may change without a change of the world model or of a parameter.
    volatile = False

    def __init__(self, clabel: str, subj: str, desired_state: bool) -> None:
        self._label = clabel
        self._subject_key = subj
        self._desired_state = desired_state
        self._checked: dict[str, str] = {}  # key -> what it was at the last evaluation
        self._ids: dict[str, str] = {}
        self._undo: list[Callable[[], None]] = []

    @property
    def label(self) -> str:
        return self._label

    @property
    def desired_state(self) -> bool:
        return self._desired_state

    # -- what subclasses define --------------------------------------------------------------------------------

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        """Whether the fact holds, whatever the desired state."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define holds")

    def fact(self) -> str:
        """The fact in words, with what the parameters were at the last evaluation."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define fact")

    def _signature(self) -> tuple[Any, ...]:
        """All that makes two conditions of this class speak of the same fact."""
        return (self._subject_key,)

    # -- the contract's interface ------------------------------------------------------------------------------

    def evaluate(self, ph: ParamHandler, wmi: Any) -> bool:
        """Whether the desired state holds."""
        for key in self.getKeys():
            self._remember(key, ph)
        return self.holds(ph, wmi) == self._desired_state

    def getDescription(self) -> str:
        """The condition with the elements that it was checked on last."""
        return f"[{self._label}] {'' if self._desired_state else 'not '}{self.fact()}"

    def remap(self, initial_key: str, target_key: str) -> None:
        """Renames a parameter key."""
        if self._subject_key == initial_key:
            self._subject_key = target_key

    def getParamId(self, key: str) -> str:
        """The id that the element in a parameter had at the last evaluation, "" when it had none."""
        return self._ids.get(key, "")

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
        copy._checked, copy._ids, copy._undo = {}, {}, []
        return copy

    # -- shared by subclasses ----------------------------------------------------------------------------------

    def _same_fact(self, other: Any) -> bool:
        return type(self) is type(other) and self._signature() == other._signature()

    def _remember(self, key: str, ph: ParamHandler) -> None:
        param = ph._params.get(key)
        value = param.value if param is not None else None
        if isinstance(value, Element):
            self._checked[key] = repr(value) if value.id else f"any {value!r}".rstrip("-")
            self._ids[key] = value.id
        else:
            self._checked[key] = f"{key} (unset)" if value is None else str(value)
            self._ids[key] = ""

    def _name(self, key: str) -> str:
        return self._checked.get(key, key)

    def _value(self, key: str, ph: ParamHandler) -> Any:
        """The parameter's value.

        :raises UnknownName: the skill has no such parameter.
        """
        param = ph._params.get(key)
        if param is None:
            raise UnknownName(f"condition {self._label!r} speaks of {key!r}; the skill has: {', '.join(ph.keys())}")
        return param.value

    def _element(self, key: str, ph: ParamHandler, wmi: Any) -> Element | None:
        """The element in a parameter as the world model has it now; the abstract one, or None, where there is none.

        :raises UnknownName: the skill has no such parameter.
        :raises WrongType: the parameter holds something else.
        """
        value = self._value(key, ph)
        if value is None:
            return None
        if not isinstance(value, Element):
            raise WrongType(f"condition {self._label!r}: parameter {key!r} is {value!r}, expected an element")
        if value.isAbstract():
            return value
        found: Element | None = wmi.find_element(value.id)
        return found
