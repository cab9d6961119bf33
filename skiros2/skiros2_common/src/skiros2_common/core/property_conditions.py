"""Conditions on the properties of an element."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import MOST_NAMED, Change, Near
from skiros2_common.core.names import full_name
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.property import same_value
from skiros2_common.core.world_element import Element

#: The operators of `ConditionProperty`.
OPERATORS: dict[str, Callable[[float, float], bool]] = {
    ">": lambda a, b: a > b,
    "<": lambda a, b: a < b,
    ">=": lambda a, b: a >= b,
    "<=": lambda a, b: a <= b,
}


class _OfProperty(ConditionBase):
    """What conditions on a property share."""

    def __init__(self, clabel: str, olabel: str, subj: str, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        self._property = full_name(olabel)

    @property
    def property(self) -> str:
        return self._property

    def is_of(self, element: Element) -> bool:
        """Whether the fact holds of an element as it is given here."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define is_of")

    def found(self, ph: ParamHandler, wmi: Any) -> str:
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            return self._lacking(self._subject_key, ph, wmi)
        return f"{self._name(self._subject_key)}: {self._property} is {self._told(element)}"

    def _told(self, element: Element) -> str:
        """The values of the property."""
        values = element.getProperty(self._property).values if element.hasProperty(self._property) else []
        return ", ".join(map(repr, values)) or "missing"

    def _changes(self, ph: ParamHandler, wmi: Any) -> list[Change]:
        return self._last(self._subject_key, self._property, ph, wmi)

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            return False
        before = element.copy()
        if not self._apply(element):
            return False
        wmi.update_element_properties(element)
        self._undo.append(lambda: _restore_property(before, self._property, wmi))
        return self.evaluate(ph, wmi)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        element = self._value(self._subject_key, ph)
        return isinstance(element, Element) and self._apply(element)

    def _apply(self, element: Element) -> bool:
        """Changes the element so that the desired state holds. False where that is not possible."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define _apply")

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self._property)
        return element


class ConditionProperty(_OfProperty):
    """True when a property compares so with a value; `=` means that the value is among the property's.

    :param olabel: the property.
    :param operator: one of `= > < >= <=`.
    :raises UnknownName: the operator is another one.
    """

    def __init__(self, clabel: str, olabel: str, subj: str, operator: str, value: Any, desired_state: bool) -> None:
        super().__init__(clabel, olabel, subj, desired_state)
        if operator != "=" and operator not in OPERATORS:
            raise UnknownName(f"condition {clabel!r}: operator {operator!r}, expected one of = {' '.join(OPERATORS)}")
        self._operator = operator
        self._desired_value = value

    @property
    def value(self) -> Any:
        """The value that the property is compared with."""
        return self._desired_value

    @property
    def is_value(self) -> bool:
        """Whether the property has to have a value, a text, number or bool: these an index finds."""
        is_plain = isinstance(self._desired_value, (str, int, float)) and self._desired_value != ""
        return is_plain and self._operator == "=" and self._desired_state

    def said_of(self, key: str, ph: ParamHandler) -> str:
        has = "with" if self._desired_state else "without"
        return f"{has} {self._property} {self._operator} {self._desired_value!r}"

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._property, self._operator, self._desired_value)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        return element is not None and self.is_of(element)

    def is_of(self, element: Element) -> bool:
        if self._operator == "=":
            return element.hasProperty(self._property, self._desired_value)
        value = element.value_of(self._property)
        try:
            return OPERATORS[self._operator](float(value), float(self._desired_value))
        except (TypeError, ValueError):
            return False  # missing, or no number

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self._property} {self._operator} {self._desired_value}"

    def expected(self) -> str:
        compared = "" if self._operator == "=" else f"{self._operator} "
        return f"{'' if self._desired_state else 'not '}{compared}{self._desired_value!r}"

    def _nearest(self, ph: ParamHandler, wmi: Any) -> list[Near]:
        having = (self._property, self._desired_value) if self.is_value else None
        others = self._others(self._subject_key, ph, wmi, having)
        fitting = (e for e in others if self.is_of(e) == self._desired_state)
        return [Near(repr(e), f"{self._property} is {self._told(e)}") for e in islice(fitting, MOST_NAMED)]

    def _apply(self, element: Element) -> bool:
        if self._operator in (">", "<"):
            return False  # no single value follows from it
        if self._desired_state:
            element.setProperty(self._property, self._desired_value, force_convertion=True)
        elif same_value(self._desired_value, True) or same_value(self._desired_value, False):
            element.setProperty(self._property, not same_value(self._desired_value, True), force_convertion=True)
        elif element.hasProperty(self._property, self._desired_value):
            element.removeProperty(self._property)
        return True

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:operator", self._operator)
        element.setProperty("skiros:desiredValue", self._desired_value)
        return element


class ConditionHasProperty(_OfProperty):
    """True when a property has a value; for a parameter without an element, true when it is optional."""

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._property)

    def evaluate(self, ph: ParamHandler, wmi: Any) -> bool:
        self._remember(self._subject_key, ph)
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            param = ph.getParam(self._subject_key)
            return param is not None and param.paramTypeIs(ParamTypes.Optional)
        return self.holds(ph, wmi) == self._desired_state

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        return element is not None and self.is_of(element)

    def is_of(self, element: Element) -> bool:
        return element.hasProperty(self._property, not_none=True)

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} has a value of {self._property}"

    def expected(self) -> str:
        return f"{'a' if self._desired_state else 'no'} value"

    def said_of(self, key: str, ph: ParamHandler) -> str:
        return f"with {self.expected()} of {self._property}"

    def _nearest(self, ph: ParamHandler, wmi: Any) -> list[Near]:
        others = self._others(self._subject_key, ph, wmi)
        fitting = (e for e in others if self.is_of(e) == self._desired_state)
        return [Near(repr(e), f"{self._property} is {self._told(e)}") for e in islice(fitting, MOST_NAMED)]

    def _apply(self, element: Element) -> bool:
        if not self._desired_state:
            element.removeProperty(self._property)
            return True
        return element.hasProperty(self._property, not_none=True)  # no value follows from it


def _restore_property(before: Element, key: str, wmi: Any) -> None:
    """Sets a property of the element in the world model to what it was in `before`."""
    element = wmi.get_element(before.id)
    if before.hasProperty(key):
        prop = before.getProperty(key)
        element.setProperty(key, prop.dataType())
        element.getProperty(key).assign(prop.values)
    else:
        element.removeProperty(key)
    wmi.update_element_properties(element)
