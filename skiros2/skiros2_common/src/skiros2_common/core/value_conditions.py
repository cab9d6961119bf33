"""Conditions on the value of a parameter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Self

from skiros2_common.core.condition import ConditionBase, ConditionRecord, Cost, is_in_scene, near_matches
from skiros2_common.core.explanation import Change, NearMatch
from skiros2_common.core.names import full_name, is_of_class
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:
    from skiros2_common.core.world_model_port import WorldModelPort


class ConditionIsSpecified(ConditionBase):
    """True if a parameter holds an element of the scene."""

    @classmethod
    def from_record(cls, record: ConditionRecord) -> Self:
        return cls(record.label, record.subject, record.state)

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        return self._ids_in_parameters(ph)

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        element = self._param_value(self._subject_key, ph)
        return bool(element.id) if isinstance(element, Element) else element is not None

    def fact(self) -> str:
        return f"{self._subject_key} is specified ({self._name(self._subject_key)})"

    def expected(self) -> str:
        return "an element of the scene" if self._desired_state else "no element"

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        missing = self._missing_reason(self._subject_key, ph, wmi)
        return missing or f"parameter {self._subject_key!r} is {self._name(self._subject_key)}"

    def _near_matches(self, ph: ParamHandler, wmi: WorldModelPort) -> list[NearMatch]:
        return near_matches(self._alternatives(self._subject_key, ph, wmi)) if self._desired_state else []

    def _changes(self, ph: ParamHandler, wmi: WorldModelPort) -> list[Change]:
        return self._last_change(self._subject_key, "", ph, wmi)

    def setTrue(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        if self.evaluate(ph, wmi):
            return True
        if self._desired_state:
            return False
        param = ph.getParam(self._subject_key)
        assert param is not None
        before = list(param.values)
        param.unset()
        self._undo.append(lambda: param.assign(before))
        return True

    def setDesiredState(self, ph: ParamHandler) -> bool:
        if self._desired_state:
            return ph.is_bound(self._subject_key)
        param = ph.getParam(self._subject_key)
        if param is None:
            return False
        param.unset()
        return True


class ConditionGenerate(ConditionIsSpecified):
    """Same as `ConditionIsSpecified`, but as an effect, the skill creates (True) or removes (False) the element.

    An element missing from the world model counts as removed.
    """

    @classmethod
    def from_record(cls, record: ConditionRecord) -> Self:
        return cls(record.label, record.subject, record.state)

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        return self._ids_in_parameters(ph)

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        element = self._param_value(self._subject_key, ph)
        return is_in_scene(element, wmi) if isinstance(element, Element) else element is not None

    def setTrue(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        if self.evaluate(ph, wmi):
            return True
        param = ph.getParam(self._subject_key)
        if param is None:
            return False
        before = list(param.values)
        if self._desired_state:
            created = (param.value or param.default or Element("sumo:Object")).copy()
            created._id = ""
            wmi.add_element(created)
            param.assign(created)
            self._undo.append(lambda: wmi.remove_element(created))
        else:
            branch = wmi.get_branch(param.value.id)
            wmi.remove_element(branch[0].id)
            removed = [e for e in branch if not wmi.is_scene_element(e.id)]  # others have a second parent
            self._undo.append(lambda: wmi.add_elements([_as_new(e) for e in removed]))
        self._undo.append(lambda: param.assign(before))
        return self.evaluate(ph, wmi)


class ConditionOnType(ConditionBase):
    """True if the value's class is the given one or a subclass of it.

    :param value: the class.
    """

    def __init__(self, clabel: str, subj: str, value: str) -> None:
        super().__init__(clabel, subj, True)
        self._value = value

    @classmethod
    def from_record(cls, record: ConditionRecord) -> Self:
        return cls(record.label, record.subject, record.name)

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        return self._ids_in_parameters(ph)

    @property
    def wanted_type(self) -> str:
        """The full name of the class."""
        return full_name(self._value)

    def ontology_names(self) -> list[tuple[str, str]]:
        return [("class", self.wanted_type)]

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self.wanted_type)

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        return element is not None and self._covers(element, wmi)

    def _covers(self, element: Element, wmi: WorldModelPort) -> bool:
        return is_of_class(element.type, self._value, wmi)

    def hasConflict(self, other: object) -> bool:
        return False  # a value may have both classes

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} is a {self.wanted_type}"

    def expected(self) -> str:
        return f"a {self.wanted_type}"

    def filter_text(self, key: str, ph: ParamHandler) -> str:
        return f"of class {self.wanted_type}"

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        element = self._element(self._subject_key, ph, wmi)
        if element is None:
            return self._missing_reason(self._subject_key, ph, wmi)
        return f"{self._name(self._subject_key)} is a {element.type}"

    def found_for(self, key: str, ph: ParamHandler, wmi: WorldModelPort) -> str:
        element = self._element(key, ph, wmi)
        return f"is a {element.type}" if element is not None else self._missing_reason(key, ph, wmi)

    def _near_matches(self, ph: ParamHandler, wmi: WorldModelPort) -> list[NearMatch]:
        others = self._alternatives(self._subject_key, ph, wmi)
        return near_matches((e for e in others if self._covers(e, wmi)), self.expected())

    def toElement(self) -> Element:
        element = super().toElement()
        element.removeProperty("skiros:desiredState")
        element.setProperty("skiros:desiredValue", self.wanted_type)
        return element

    def setDesiredState(self, ph: ParamHandler) -> bool:
        element = self._param_value(self._subject_key, ph)
        if not isinstance(element, Element) or not element.isAbstract():
            return False
        element.type = self._value
        return True


class ConditionFunction(ConditionBase):
    """True if a function of the parameters' values returns the desired state.

    :param keys: the parameters whose (first) values are passed to the function, in this order.
    :param function: called in the tick; it must be fast.
    """

    volatile = True  # a value may be changed in place
    cost = Cost.CODE

    def __init__(
        self, clabel: str, keys: Sequence[str], function: Callable[..., Any], desired_state: bool = True
    ) -> None:
        super().__init__(clabel, keys[0] if keys else "", desired_state)
        self._keys = list(keys)
        self._function = function

    def _signature(self) -> tuple[Any, ...]:
        return (tuple(self._keys), self._function)

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        return self._ids_in_parameters(ph)

    def getKeys(self) -> list[str]:
        return list(self._keys)

    def remap(self, initial_key: str, target_key: str) -> None:
        super().remap(initial_key, target_key)
        self._keys = [target_key if key == initial_key else key for key in self._keys]

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        return bool(self._function(*(self._param_value(key, ph) for key in self._keys)))

    def fact(self) -> str:
        name = getattr(self._function, "__name__", "function")
        return f"{name}({', '.join(self._name(key) for key in self._keys)})"

    def expected(self) -> str:
        return str(self._desired_state)

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        return f"{self.fact()} is {not self._desired_state}"


def _as_new(removed: Element) -> Element:
    """A removed element, ready to be added again with its id and relations."""
    element = Element(removed.type, removed.label, removed.id)
    for prop in removed.properties:
        element.setProperty(prop.key, prop.dataType())
        element.getProperty(prop.key).assign(prop.values)
    for relation in removed.getRelations():
        element.addRelation(relation["src"], relation["type"], relation["dst"])
    return element
