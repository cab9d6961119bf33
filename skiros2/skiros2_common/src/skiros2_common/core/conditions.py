"""Conditions of skills over the world model.

A condition has a label, the keys of the parameters it speaks of, and a desired state. `ph` is the `ParamHandler` of the
skill, `wmi` the world model. Facts are read from the world model at each evaluation. A fact about an unset parameter, a
missing property or an element that does not exist is false.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongType
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
        value = ph.getParamValue(key) if ph.hasParam(key) else None
        if isinstance(value, Element):
            self._checked[key] = repr(value) if not value.isAbstract() else f"any {value!r}".rstrip("-")
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
        if not ph.hasParam(key):
            raise UnknownName(f"condition {self._label!r} speaks of {key!r}; the skill has: {', '.join(ph.keys())}")
        return ph.getParamValue(key)

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


class ConditionOr(ConditionBase):
    """True when one of its parts holds."""

    def __init__(self, desired_state: bool) -> None:
        super().__init__("Or", "", desired_state)
        self._conditions: list[Any] = []

    @property
    def conditions(self) -> list[Any]:
        return self._conditions

    @property
    def volatile(self) -> bool:  # type: ignore[override]
        return any(c.volatile for c in self._conditions)

    def addCondition(self, condition: Any) -> None:
        """Adds a part."""
        self._conditions.append(condition)

    def remap(self, initial_key: str, target_key: str) -> None:
        for condition in self._conditions:
            condition.remap(initial_key, target_key)

    def getKeys(self) -> list[str]:
        return list(dict.fromkeys(key for c in self._conditions for key in c.getKeys()))

    def isEqual(self, other: Any) -> bool:
        return self._matches(other) and bool(self._desired_state == other._desired_state)

    def hasConflict(self, other: Any) -> bool:
        return self._matches(other) and bool(self._desired_state != other._desired_state)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        checked = [c.evaluate(ph, wmi) for c in self._conditions]  # all, so that the description names them all
        return any(checked)

    def fact(self) -> str:
        return "(" + " or ".join(c.getDescription() for c in self._conditions) + ")"

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        return self._desired_state and any(c.setTrue(ph, wmi) for c in self._conditions)

    def revert(self, ph: ParamHandler | None = None, wmi: Any = None) -> None:
        for condition in reversed(self._conditions):
            condition.revert(ph, wmi)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        return self._desired_state and any(c.setDesiredState(ph) for c in self._conditions)

    def toElement(self) -> Element:
        element = super().toElement()
        for condition in self._conditions:
            element.addRelation("-1", "skiros:hasCondition", condition.toElement())
        return element

    def copy(self) -> Any:
        copy = super().copy()
        copy._conditions = [c.copy() for c in self._conditions]
        return copy

    def _matches(self, other: Any) -> bool:
        return (
            isinstance(other, ConditionOr)
            and len(self._conditions) == len(other._conditions)
            and all(a.isEqual(b) for a, b in zip(self._conditions, other._conditions, strict=True))
        )


class ConditionProperty(ConditionBase):
    """True when a property compares so with a value; `=` means that the value is among the property's.

    :param olabel: the property.
    :param operator: one of `= > < >= <=`.
    :raises UnknownName: the operator is another one.
    """

    def __init__(self, clabel: str, olabel: str, subj: str, operator: str, value: Any, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        if operator != "=" and operator not in OPERATORS:
            raise UnknownName(f"condition {clabel!r}: operator {operator!r}, expected one of = {' '.join(OPERATORS)}")
        self._property = full_name(olabel)
        self._operator = operator
        self._desired_value = value

    @property
    def property(self) -> str:
        return self._property

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._property, self._operator, self._desired_value)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        if element is None:
            return False
        if self._operator == "=":
            return element.hasProperty(self._property, self._desired_value)
        value = element.value_of(self._property)
        try:
            return OPERATORS[self._operator](float(value), float(self._desired_value))
        except (TypeError, ValueError):
            return False  # missing, or no number

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self._property} {self._operator} {self._desired_value}"

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
        element.setProperty("skiros:appliedOnType", self._property)
        element.setProperty("skiros:operator", self._operator)
        element.setProperty("skiros:desiredValue", self._desired_value)
        return element


class ConditionHasProperty(ConditionBase):
    """True when a property has a value; for a parameter without an element, true when it is optional."""

    def __init__(self, clabel: str, olabel: str, subj: str, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        self._property = full_name(olabel)

    @property
    def property(self) -> str:
        return self._property

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
        return element is not None and element.hasProperty(self._property, not_none=True)

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} has a value of {self._property}"

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        element = self._element(self._subject_key, ph, wmi)
        if element is None or element.isAbstract():
            return False
        before = element.copy()
        self._apply(element)
        wmi.update_element_properties(element)
        self._undo.append(lambda: _restore_property(before, self._property, wmi))
        return True

    def setDesiredState(self, ph: ParamHandler) -> bool:
        element = self._value(self._subject_key, ph)
        if not isinstance(element, Element):
            return False
        self._apply(element)
        return True

    def _apply(self, element: Element) -> None:
        if not self._desired_state:
            element.removeProperty(self._property)
        elif not element.hasProperty(self._property, not_none=True):
            element.setProperty(self._property, "", force_convertion=False)

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self._property)
        return element


class ConditionRelation(ConditionBase):
    """True when a relation, or one under it, holds between two parameters.

    An unset side means "some element of its type". A relation that a reasoner owns is asked of it.

    :param olabel: the relation.
    :param obj: key of the object parameter.
    """

    abstract = False

    def __init__(self, clabel: str, olabel: str, subj: str, obj: str, desired_state: bool) -> None:
        super().__init__(clabel, subj, desired_state)
        self._relation = full_name(olabel)
        self._object_key = obj

    @property
    def relation(self) -> str:
        return self._relation

    @property
    def subject_key(self) -> str:
        return self._subject_key

    @property
    def object_key(self) -> str:
        return self._object_key

    def remap(self, initial_key: str, target_key: str) -> None:
        super().remap(initial_key, target_key)
        if self._object_key == initial_key:
            self._object_key = target_key

    def getKeys(self) -> list[str]:
        return list(dict.fromkeys([self._subject_key, self._object_key]))

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._relation, self._object_key)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        subj = self._element(self._subject_key, ph, wmi)
        obj = self._element(self._object_key, ph, wmi)
        subj = self._default(self._subject_key, ph) if subj is None else subj
        obj = self._default(self._object_key, ph) if obj is None else obj
        if subj is None or obj is None:
            return False
        return bool(wmi.check_relation(subj, self._relation, obj, True, self.abstract))

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} {self._relation} {self._name(self._object_key)}"

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        subj = self._element(self._subject_key, ph, wmi)
        obj = self._element(self._object_key, ph, wmi)
        if subj is None or obj is None or subj.isAbstract() or obj.isAbstract():
            return False
        if self._desired_state:
            changed = [{"src": subj.id, "type": self._relation, "dst": obj.id}]
        else:
            changed = list(wmi.get_relations(subj.id, self._relation, obj.id))
        _set_relations(changed, self._desired_state, wmi)
        self._undo.append(lambda: _set_relations(changed, not self._desired_state, wmi))
        return self.evaluate(ph, wmi)

    def setDesiredState(self, ph: ParamHandler) -> bool:
        subj = self._value(self._subject_key, ph)
        obj = self._value(self._object_key, ph)
        if not isinstance(subj, Element) or not isinstance(obj, Element) or obj.isAbstract():
            return False
        if self._desired_state:
            subj.addRelation("-1", self._relation, obj.id)
        else:
            subj.removeRelations(subj.getRelations("-1", self._relation, obj.id))
        return True

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self._relation)
        element.setProperty("skiros:hasObject", self._object_key)
        return element

    def _default(self, key: str, ph: ParamHandler) -> Element | None:
        """For an unset parameter, the abstract element that it was declared with."""
        param = ph.getParam(key)
        if param is None or param.value is not None or not isinstance(param.default, Element):
            return None
        return param.default if param.default.isAbstract() else None


class AbstractConditionRelation(ConditionRelation):
    """True when the ontology allows the relation between the classes, or has it between the templates."""

    abstract = True

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        return self.evaluate(ph, wmi)  # the ontology is not an effect

    def setDesiredState(self, ph: ParamHandler) -> bool:
        return False


class ConditionIsSpecified(ConditionBase):
    """True when a parameter holds an element of the scene."""

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        element = self._value(self._subject_key, ph)
        if isinstance(element, Element):
            return not element.isAbstract() and wmi.find_element(element.id) is not None
        return element is not None

    def fact(self) -> str:
        return f"{self._subject_key} is specified ({self._name(self._subject_key)})"

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
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
            return ph.isSpecified(self._subject_key)
        param = ph.getParam(self._subject_key)
        if param is None:
            return False
        param.unset()
        return True


class ConditionGenerate(ConditionIsSpecified):
    """As `ConditionIsSpecified`; as an effect the skill makes the element (true) or removes it (false)."""

    def setTrue(self, ph: ParamHandler, wmi: Any) -> bool:
        if self.evaluate(ph, wmi):
            return True
        param = ph.getParam(self._subject_key)
        if param is None:
            return False
        before = list(param.values)
        if self._desired_state:
            made = (param.value or param.default or Element("sumo:Object")).copy()
            made._id = ""
            wmi.add_element(made)
            param.assign(made)
            self._undo.append(lambda: wmi.remove_element(made))
        else:
            gone = wmi.get_element(param.value.id)
            wmi.remove_element(gone)
            self._undo.append(lambda: wmi.add_element(_as_new(gone)))
        self._undo.append(lambda: param.assign(before))
        return self.evaluate(ph, wmi)


class ConditionOnType(ConditionBase):
    """True when the value's class is the given one or under it.

    :param value: the class.
    """

    def __init__(self, clabel: str, subj: str, value: str) -> None:
        super().__init__(clabel, subj, True)
        self._type = full_name(value)

    def _signature(self) -> tuple[Any, ...]:
        return (self._subject_key, self._type)

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        element = self._element(self._subject_key, ph, wmi)
        return element is not None and bool(element.type == self._type or wmi.is_subclass(element.type, self._type))

    def hasConflict(self, other: Any) -> bool:
        return False  # a value may be of both classes

    def fact(self) -> str:
        return f"{self._name(self._subject_key)} is a {self._type}"

    def toElement(self) -> Element:
        element = super().toElement()
        element.setProperty("skiros:appliedOnType", self._type)
        return element


class ConditionFunction(ConditionBase):
    """True when a function of the keys' values gives the desired state.

    :param keys: the parameters whose (first) values the function gets, in that order.
    :param function: called in the tick; it must be quick.
    """

    volatile = True

    def __init__(
        self, clabel: str, keys: Sequence[str], function: Callable[..., Any], desired_state: bool = True
    ) -> None:
        super().__init__(clabel, keys[0] if keys else "", desired_state)
        self._keys = list(keys)
        self._function = function

    def _signature(self) -> tuple[Any, ...]:
        return (tuple(self._keys), self._function)

    def getKeys(self) -> list[str]:
        return list(self._keys)

    def remap(self, initial_key: str, target_key: str) -> None:
        super().remap(initial_key, target_key)
        self._keys = [target_key if key == initial_key else key for key in self._keys]

    def holds(self, ph: ParamHandler, wmi: Any) -> bool:
        return bool(self._function(*(self._value(key, ph) for key in self._keys)))

    def fact(self) -> str:
        name = getattr(self._function, "__name__", "function")
        return f"{name}({', '.join(self._name(key) for key in self._keys)})"


def _set_relations(relations: Sequence[Any], state: bool, wmi: Any) -> None:
    for relation in relations:
        wmi.set_relation(relation["src"], relation["type"], relation["dst"], state)


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


def _as_new(gone: Element) -> Element:
    """A removed element to be added again, under its old id and with its relations."""
    element = Element(gone.type, gone.label, gone.id)
    for prop in gone.properties:
        element.setProperty(prop.key, prop.dataType())
        element.getProperty(prop.key).assign(prop.values)
    for relation in gone.getRelations():
        element.addRelation(relation["src"], relation["type"], relation["dst"])
    return element
