"""Conditions on the properties of an element."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import TYPE_CHECKING, Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import MAX_EXAMPLES, Change, NearMatch
from skiros2_common.core.names import full_name
from skiros2_common.core.params import ParamHandler, ParamTypes
from skiros2_common.core.property import same_value
from skiros2_common.core.wording import wrong_value
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:
    from skiros2_common.core.world_model_port import WorldModelPort

#: The operators of `ConditionProperty`.
OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    ">": lambda a, b: a > b,
    "<": lambda a, b: a < b,
    ">=": lambda a, b: a >= b,
    "<=": lambda a, b: a <= b,
}


class _OfProperty(ConditionBase):
    """Base of the conditions on a property."""

    wants_elements = True

    def __init__(self, clabel: str, olabel: str, subj: str, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        self._owl_label = olabel

    @property
    def property(self) -> str:
        """The full name of the property."""
        return full_name(self._owl_label)

    def ontology_names(self) -> list[tuple[str, str]]:
        return [("property", self.property)]

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        return element is not None and self.holds_for(element)

    def holds_for(self, element: Element) -> bool:
        """Whether the fact holds for an element, as passed."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define holds_for")

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        missing = self._missing_reason(self._subject_key, ph, wmi)
        element = self._element(self._subject_key, ph, wmi)
        if missing or element is None:
            return missing
        return f"{self._name(self._subject_key)}: {self.property} is {self._values_text(element)}"

    def statement(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            return super().statement(ph, wmi)
        values = element.getProperty(self.property).values if element.hasProperty(self.property) else []
        return wrong_value(self.property, repr(element), ", ".join(map(str, values)), self._wanted_text())

    def _wanted_text(self) -> str:
        """The wanted value or comparison, for people; "" if no value is wanted."""
        return ""

    def _values_text(self, element: Element) -> str:
        """The values of the property, as text."""
        values = element.getProperty(self.property).values if element.hasProperty(self.property) else []
        return ", ".join(map(repr, values)) or "missing"

    def _near_matches(self, ph: ParamHandler, wmi: WorldModelPort) -> list[NearMatch]:
        others = self._alternatives(self._subject_key, ph, wmi, self.indexed_value())
        matching = islice((e for e in others if self.holds_for(e) == self._desired_state), MAX_EXAMPLES)
        return [NearMatch(repr(e), f"{self.property} is {self._values_text(e)}") for e in matching]

    def found_for(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> str:
        element = self._element(key, ph, wmi)
        missing = self._missing_reason(key, ph, wmi)
        return missing if missing or element is None else f"{self.property} is {self._values_text(element)}"

    def _changes(self, ph: ParamHandler, wmi: WorldModelPort) -> list[Change]:
        return self._last_change(self._subject_key, self.property, ph, wmi)

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            return False
        before = element.copy()
        if not self._apply(element):
            return False
        wmi.update_element_properties(element)
        self._undo.append(lambda: _restore_property(before, self.property, wmi))
        return True

    def setDesiredState(self, ph: ParamHandler) -> bool:
        element = self._param_value(self._subject_key, ph)
        if not isinstance(element, Element):
            return False
        return self._describe(element) if element.isAbstract() else self._apply(element)

    def _describe(self, element: Element) -> bool:
        """Adds the wanted state to an abstract element. Returns False if that is impossible."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define _describe")

    def _apply(self, element: Element) -> bool:
        """Changes the element so that it satisfies the condition. Returns False if that is impossible."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define _apply")

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self.property)
        return element


class ConditionProperty(_OfProperty):
    """True if the comparison of a property with a value holds; `=` tests whether the property has the value.

    :param olabel: the property.
    :param operator: one of `= > < >= <=`.
    :raises UnknownName: unknown operator.
    """

    def __init__(self, clabel: str, olabel: str, subj: str, operator: str, value: Any, desired_state: bool) -> None:
        super().__init__(clabel, olabel, subj, desired_state)
        if operator != "=" and operator not in OPERATORS:
            raise UnknownName(f"condition {clabel!r}: operator {operator!r}, expected one of = {' '.join(OPERATORS)}")
        self._operator = operator
        self._value = value

    record_fields = ("label", "name", "subject", "operator", "value", "state")
    planned_as = "value"
    element_ids = ConditionBase.ids_in_parameters

    @property
    def value(self) -> Any:
        """The value to compare the property with."""
        return self._value

    def indexed_value(self) -> tuple[str, Any] | None:
        is_plain = isinstance(self._value, (str, int, float)) and self._value != ""
        return (self.property, self._value) if is_plain and self._operator == "=" and self._desired_state else None

    def filter_text(self, key: str, ph: ParamHandler) -> str:
        has = "with" if self._desired_state else "without"
        return f"{has} {self.property} {self._operator} {self._value!r}"

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self.property, self._operator, self._value)

    def evaluate(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        self._remember(self._subject_key, ph)
        if self.holds(ph, wmi) != self._desired_state:
            return False
        if self._desired_state or self._operator == "=":
            return True
        element = self._element(self._subject_key, ph, wmi)  # a missing value satisfies no comparison
        return element is not None and element.value_of(self.property) is not None

    def satisfied_by(self, element: Element) -> bool:
        if self._operator == "=":
            return self.holds_for(element) == self._desired_state
        value = element.value_of(self.property)
        return value is not None and self._compares(value) == self._desired_state

    def holds_for(self, element: Element) -> bool:
        if self._operator == "=":
            return element.hasProperty(self.property, self._value)
        return self._compares(element.value_of(self.property))

    def _compares(self, value: Any) -> bool:
        """Whether the comparison holds for a value."""
        operator = OPERATORS[self._operator]
        try:
            return bool(operator(float(value), float(self._value)))
        except (TypeError, ValueError):
            is_text = isinstance(value, str) and isinstance(self._value, str)
            return is_text and bool(operator(value, self._value))

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self.property} {self._operator} {self._value}"

    def expected(self) -> str:
        compared = "" if self._operator == "=" else f"{self._operator} "
        return f"{'' if self._desired_state else 'not '}{compared}{self._value!r}"

    def _wanted_text(self) -> str:
        compared = "" if self._operator == "=" else f"{self._operator} "
        if not self._desired_state and not compared:
            return ""
        return f"{'' if self._desired_state else 'not '}{compared}{self._value}"

    def _apply(self, element: Element) -> bool:
        if self._operator in (">", "<"):
            return False  # determines no value
        if self._desired_state:
            element.setProperty(self.property, self._value, force_convertion=True)
        elif same_value(self._value, True) or same_value(self._value, False):
            element.setProperty(self.property, not same_value(self._value, True), force_convertion=True)
        elif element.hasProperty(self.property, self._value):
            element.removeProperty(self.property)
        return True

    def example_value(self, wmi: WorldModelPort) -> str | bool | float | None:
        if isinstance(self._value, bool) or not isinstance(self._value, int | float):
            return None
        return self._value + (1.0 if (self._operator in (">", ">=")) == self._desired_state else -1.0)

    def _describe(self, element: Element) -> bool:
        value = self._value
        if not self._desired_state:
            if not isinstance(value, bool):
                return False
            value = not value
        if not element.hasProperty(self.property, value):
            element.appendProperty(self._owl_label, value)
        return True

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:operator", self._operator)
        element.setProperty("skiros:desiredValue", self._value)
        return element


class ConditionHasProperty(_OfProperty):
    """True if a property has a value; for a parameter without an element, True if it is optional."""

    record_fields = ("label", "name", "subject", "state")
    planned_as = "has"
    element_ids = ConditionBase.ids_in_parameters

    def satisfied_by(self, element: Element) -> bool:
        return self.holds_for(element) == self._desired_state

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self.property)

    def evaluate(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        self._remember(self._subject_key, ph)
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            param = ph.getParam(self._subject_key)
            return param is not None and param.paramTypeIs(ParamTypes.Optional)
        return self.holds(ph, wmi) == self._desired_state

    def holds_for(self, element: Element) -> bool:
        return element.hasProperty(self.property, not_none=True)

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} has a value of {self.property}"

    def expected(self) -> str:
        return f"{'a' if self._desired_state else 'no'} value"

    def filter_text(self, key: str, ph: ParamHandler) -> str:
        return f"with {self.expected()} of {self.property}"

    def _apply(self, element: Element) -> bool:
        if not self._desired_state:
            element.removeProperty(self.property)
            return True
        return element.hasProperty(self.property, not_none=True)  # determines no value

    def example_value(self, wmi: WorldModelPort) -> str | bool | float | None:
        examples: dict[str | None, str | bool] = {"xsd:boolean": True, "xsd:string": "some", None: "some"}
        return examples.get(wmi.get_datatype(self.property), 1.0) if self._desired_state else None

    def _describe(self, element: Element) -> bool:
        if self._desired_state and not element.hasProperty(self.property):
            element.setProperty(self._owl_label, str)
        return self._desired_state


def _restore_property(before: Element, key: str, wmi: WorldModelPort) -> None:
    """Sets a property of the element in the world model to its values in `before`."""
    element = wmi.get_element(before.id)
    if before.hasProperty(key):
        prop = before.getProperty(key)
        element.setProperty(key, prop.dataType())
        element.getProperty(key).assign(prop.values)
    else:
        element.removeProperty(key)
    wmi.update_element_properties(element)
