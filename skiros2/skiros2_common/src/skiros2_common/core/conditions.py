"""Conditions of skills over the world model.

A condition has a label, the keys of its parameters, and a desired state. `ph` is always the `ParamHandler` of the skill
and `wmi` the world model. Each evaluation reads the facts from the world model. A fact about an unset parameter, a
missing property or a missing element is false.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Self, TypeGuard

from skiros2_common.core.condition import (
    ConditionBase,
    is_in_scene,
    near_matches,
)
from skiros2_common.core.condition_record import ConditionRecord, Cost
from skiros2_common.core.explanation import Change, Finding, NearMatch
from skiros2_common.core.names import full_name, is_of_class
from skiros2_common.core.params import ParamHandler
from skiros2_common.core.property_conditions import ConditionHasProperty, ConditionProperty
from skiros2_common.core.relation_conditions import AbstractConditionRelation, ConditionRelation
from skiros2_common.core.signal_condition import ConditionSignal
from skiros2_common.core.wording import a, words
from skiros2_common.core.world_element import Element

if TYPE_CHECKING:
    from skiros2_common.core.signals import SignalBounds, SignalSource
    from skiros2_common.core.world_model_port import WorldModelPort

__all__ = [
    "AbstractConditionRelation",
    "ConditionBase",
    "ConditionFunction",
    "ConditionGenerate",
    "ConditionHasProperty",
    "ConditionIsSpecified",
    "ConditionOnType",
    "ConditionOr",
    "ConditionProperty",
    "ConditionRelation",
    "ConditionSignal",
    "condition_from",
]


def condition_from(record: ConditionRecord) -> ConditionBase | None:
    """Creates the condition of a record; None if its class is not loaded, or has no `from_record`."""
    cls = ConditionBase.classes.get(record.kind)
    return cls.from_record(record) if cls is not None else None


class ConditionOr(ConditionBase):
    """True if one of its parts holds."""

    planned_as = "any"

    def __init__(self, desired_state: bool) -> None:
        super().__init__("or", "", desired_state)
        self._conditions: list[ConditionBase] = []

    @property
    def parts(self) -> list[ConditionBase]:
        return self._conditions

    @property
    def volatile(self) -> bool:  # type: ignore[override]
        return any(c.volatile for c in self._conditions)

    @property
    def cost(self) -> Cost:  # type: ignore[override]
        return max((c.cost for c in self._conditions), default=Cost.ELEMENT) or Cost.ELEMENT

    def addCondition(self, condition: ConditionBase) -> None:
        """Adds a part."""
        self._conditions.append(condition)

    def element_ids(self, ph: ParamHandler) -> set[str] | None:
        ids: set[str] = set()
        for condition in self._conditions:
            found = condition.element_ids(ph)
            if found is not None:
                ids |= found
            elif not condition.volatile:
                return None
        return ids

    def watch(
        self, ph: ParamHandler, wmi: WorldModelPort, signals: SignalSource, wake: Callable[[], None]
    ) -> Callable[[], None] | None:
        stops = [stop for c in self._conditions if (stop := c.watch(ph, wmi, signals, wake)) is not None]

        def stop_all() -> None:
            for stop in stops:
                stop()

        return stop_all if stops else None

    def signal_bounds(self) -> list[SignalBounds]:
        return [bounds for c in self._conditions for bounds in c.signal_bounds()]

    @classmethod
    def from_record(cls, record: ConditionRecord) -> Self | None:
        either = cls(record.state)
        for part in record.parts:
            condition = condition_from(part)
            if condition is None:
                return None
            either.addCondition(condition)
        return either

    def remap(self, initial_key: str, target_key: str) -> None:
        for condition in self._conditions:
            condition.remap(initial_key, target_key)

    def getKeys(self) -> list[str]:
        return list(dict.fromkeys(key for c in self._conditions for key in c.getKeys()))

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        results = [c.evaluate(ph, wmi) for c in self._conditions]  # all of them, for the description
        return any(results)

    def fact(self) -> str:
        return "(" + " or ".join(c.getDescription() for c in self._conditions) + ")"

    def explain(self, ph: ParamHandler, wmi: WorldModelPort) -> Finding:
        finding = super().explain(ph, wmi)
        if self._desired_state:
            finding.parts = [c.explain(ph, wmi) for c in self._conditions]
        return finding

    def expected(self) -> str:
        if not self._desired_state:
            return "none of them"
        return " or ".join(f"[{c.label}] {c.expected()}" for c in self._conditions)

    def found(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        if self._desired_state:
            return "; ".join(c.found(ph, wmi) for c in self._conditions)
        return "; ".join(c.getDescription() for c in self._conditions if c.evaluate(ph, wmi))

    def statement(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        parts = (c for c in self._conditions if c.evaluate(ph, wmi) != self._desired_state)
        return " and ".join(c.statement(ph, wmi) if self._desired_state else c.describe() for c in parts)

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        return self._desired_state and any(c.setTrue(ph, wmi) for c in self._conditions)

    def revert(self, ph: ParamHandler | None = None, wmi: WorldModelPort | None = None) -> None:
        for condition in reversed(self._conditions):
            condition.revert(ph, wmi)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        return self._desired_state and any(c.setDesiredState(ph) for c in self._conditions)

    def toElement(self) -> Element:
        element = super().toElement()
        element.removeProperty("skiros:hasSubject")
        for condition in self._conditions:
            element.addRelation("-1", "skiros:hasCondition", condition.toElement())
        return element

    def copy(self) -> Self:
        copy = super().copy()
        copy._conditions = [c.copy() for c in self._conditions]
        return copy

    def _same_fact(self, other: object) -> TypeGuard[Self]:
        return (
            isinstance(other, ConditionOr)
            and len(self._conditions) == len(other._conditions)
            and all(a.isEqual(b) for a, b in zip(self._conditions, other._conditions, strict=True))
        )


class ConditionIsSpecified(ConditionBase):
    """True if a parameter holds an element of the scene."""

    record_fields = ("label", "subject", "state")
    planned_as = "specified"
    element_ids = ConditionBase.ids_in_parameters

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

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
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

    record_fields = ("label", "subject", "state")
    planned_as = "in scene"
    element_ids = ConditionBase.ids_in_parameters

    def holds(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
        element = self._param_value(self._subject_key, ph)
        return is_in_scene(element, wmi) if isinstance(element, Element) else element is not None

    def _make_true(self, ph: ParamHandler, wmi: WorldModelPort) -> bool:
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
        return True


class ConditionOnType(ConditionBase):
    """True if the value's class is the given one or a subclass of it.

    :param value: the class.
    """

    def __init__(self, clabel: str, subj: str, value: str) -> None:
        super().__init__(clabel, subj, True)
        self._value = value

    record_fields = ("label", "subject", "name")
    planned_as = "is a"
    element_ids = ConditionBase.ids_in_parameters

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

    def statement(self, ph: ParamHandler, wmi: WorldModelPort) -> str:
        element = self._element(self._subject_key, ph, wmi)
        if element is None:
            return super().statement(ph, wmi)
        return f"{element!r} is {a(words(element.type))}, not {a(words(self.wanted_type))}"

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

    element_ids = ConditionBase.ids_in_parameters

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
