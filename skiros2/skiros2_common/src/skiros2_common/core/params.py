"""Parameters of skills."""

from __future__ import annotations

import logging
import time as time_module
from collections.abc import ItemsView, Iterator, KeysView, ValuesView
from copy import deepcopy
from datetime import datetime
from enum import Enum
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_common.core.names import nearest
from skiros2_common.core.property import Property
from skiros2_common.core.revision import local_revision
from skiros2_common.core.world_element import Element

log = logging.getLogger(__name__)

ParamTypes = Enum("ParamTypes", "Required Optional Inferred")


class Origin(Enum):
    """Where a value comes from. A start keeps given values; it may replace the others by inference."""

    GIVEN = "given"  # by a caller, `specify` or a default
    INFERRED = "inferred"
    ASSIGNED = "assigned"  # by the code of a skill: another element than before


#: The codes of parameter types in messages and in the world model.
PARAM_TYPE_CODES = {ParamTypes.Required: 0, ParamTypes.Optional: 1, ParamTypes.Inferred: 2}

_KINDS = {code: kind for kind, code in PARAM_TYPE_CODES.items()}


class Param(Property):
    """A property with a description, a parameter type and a declared default.

    :param value: a default, a Python type (no default), a list of one type, or an abstract `Element`.
    :param param_type: one of `ParamTypes`, or its code.
    :param limits: the unit and the allowed values. The setters accept other values; a start with them is refused.
    """

    __slots__ = (
        "_description", "_last_update", "assigned", "defaults", "limits", "origin", "paramType", "set_by",
        "shared_snapshot",
    )  # fmt: skip

    def __init__(self, key: str, description: str, value: Any, param_type: Any, limits: Limits = NO_LIMITS) -> None:
        super().__init__(key, value)
        self._description = description
        self.paramType: Any = _KINDS.get(param_type, param_type) if isinstance(param_type, int) else param_type
        #: All default values.
        self.defaults: list[Any] = list(self.current)
        self._last_update = time_module.time()
        self.limits = limits
        #: Set to True by each setter; the caller resets it.
        self.assigned = False
        #: On a blackboard: the label of the node that set the values, and their origin.
        self.set_by = ""
        self.origin = Origin.GIVEN
        #: A copy of the value list from the last check for changes in place; None while nobody else holds the list.
        self.shared_snapshot: list[Any] | None = None

    @property
    def values(self) -> list[Any]:
        """All values: the list itself, no copy."""
        if self.shared_snapshot is None:
            self.shared_snapshot = list(self.current)
            local_revision.advance()
        return self.current

    @values.setter
    def values(self, value: Any) -> None:
        self.setValues(value)

    @property
    def default(self) -> Any:
        """The first default value, or None."""
        return self.defaults[0] if self.defaults else None

    @property
    def last_update(self) -> datetime:
        """The time of the last setter call, or of the creation. Local time."""
        return datetime.fromtimestamp(self._last_update)

    def hasChanges(self, time: Any, tolerance: float = 1) -> bool:
        """Whether a setter was called since `time` (a datetime, seconds since the epoch, or a ROS time).

        :param tolerance: a call counts if it is later by more than this (µs).
        """
        if isinstance(time, datetime):
            since = time.timestamp()
        else:
            since = time.to_sec() if hasattr(time, "to_sec") else float(time)
        return self._last_update - since > tolerance * 1e-6

    def _record_set(self) -> None:
        super()._record_set()
        self.assigned = True
        self._last_update = time_module.time()

    def setValues(self, value: Any) -> None:
        super().setValues(value)
        self._record_set()
        if self.current is value:
            self.shared_snapshot = list(value)  # the caller holds the list

    def is_bound(self) -> bool:
        """Whether it has a value that is not an abstract element."""
        values = self.current
        return bool(values) and not (isinstance(values[0], Element) and values[0].isAbstract())

    def hasSpecifiedDefault(self) -> bool:
        """Whether it has a default; an abstract element counts."""
        return bool(self.defaults)

    def has_bound_default(self) -> bool:
        """Whether it has a default that is not an abstract element."""
        return bool(self.defaults) and not _is_abstract(self.defaults[0])

    def getDefaultValue(self, index: int = 0) -> Any:
        """The default at `index`, or None if there is no default.

        :raises IndexError: there are defaults, but none at this index.
        """
        return self.defaults[index] if self.defaults else None

    def getDefaultValues(self) -> list[Any]:
        return self.defaults

    def keeps_default(self, values: list[Any]) -> bool:
        """Whether the default takes precedence over new values: it exists, is not an abstract element, and its elements
        differ in id from the new ones."""
        default = self.defaults
        if not default or _is_abstract(default[0]):
            return False
        ids = [getattr(value, "id", None) for value in values]
        return not (isinstance(default[0], Element) and [e.id for e in default] == ids)

    def hasDefaultValues(self) -> bool:
        """Whether the values equal the defaults; elements are compared by id, class and label."""
        return len(self.current) <= len(self.defaults) and all(map(_is_same, self.current, self.defaults))

    def makeDefault(self, values: Any) -> None:
        """Sets the values and copies the list to the default. Values of another type are rejected with a logged error;
        then the current values become the default."""
        self.setValues(values)
        self.defaults = list(self.current)

    def setDefault(self) -> None:
        """Sets the values to a copy of the default."""
        self._set(self.new_default())

    def new_default(self) -> list[Any]:
        """The default values: copies, because the skill may change an abstract element or a dict in place."""
        return [_copied(v) for v in self.defaults]

    def clone(self) -> Param:
        """A copy with its own value list (the values themselves are shared)."""
        return self.with_values(list(self.current))

    def with_values(self, values: list[Any]) -> Param:
        """A copy with these values: the list itself, unchecked."""
        copy = Param.__new__(Param)  # faster than __init__: each skill run copies its parameters
        copy.key = self.key
        copy._data_type = self._data_type
        copy.current = values
        copy._description = self._description
        copy.paramType = self.paramType
        copy.defaults = self.defaults
        copy._last_update = self._last_update
        copy.limits = self.limits
        copy.assigned = False
        copy.set_by = ""
        copy.origin = Origin.GIVEN
        copy.shared_snapshot = None
        return copy

    @property
    def description(self) -> str:
        return self._description

    @property
    def _param_type(self) -> Any:
        # Libraries read it.
        return self.paramType

    def paramTypeIs(self, ptype: Any) -> bool:
        return bool(self.paramType == ptype)

    @property
    def is_element(self) -> bool:
        """Whether the values are elements."""
        return self._data_type is Element or issubclass(self._data_type, Element)

    @property
    def element_type(self) -> str:
        """The required class of element values; "" if the parameter does not state it."""
        for value in (*self.defaults, *self.current):
            if isinstance(value, Element):
                return value.type
        return ""

    def toElement(self) -> Element:
        """The parameter as an element of the world model (type `skiros:Parameter`).

        The value of `skiros:DataType` is the class of an element parameter; for others it has a data type and no value.
        """
        element = Element("skiros:Parameter", self.key)
        element.setProperty("rdfs:comment", self._description)
        element.setProperty("skiros:ParameterType", PARAM_TYPE_CODES[self.paramType])
        if self.is_element:
            element.setProperty("skiros:DataType", self.element_type)
            for value in self.current:
                if not value.isAbstract():
                    element.addRelation("-1", "skiros:hasValue", value.id)
            return element
        element.setProperty("skiros:DataType", self._data_type)
        if self.defaults:
            element.setProperty("skiros:Default", list(self.defaults))
        if self.current:
            element.setProperty("skiros:Value", list(self.current))
        self._add_limits(element)
        return element

    def _add_limits(self, element: Element) -> None:
        limits = self.limits
        if limits.unit:
            element.setProperty("skiros:Unit", limits.unit)
        for key, bound in (("skiros:LowerBound", limits.minimum), ("skiros:UpperBound", limits.maximum)):
            if bound is not None:
                element.setProperty(key, float(bound))
        if limits.choices:
            element.setProperty("skiros:hasValues", limits.choices_of(self._data_type))


class ParamHandler:
    """The parameters of one skill by key, in the order of declaration.

    :param is_strict: whether `handler[key]` raises for an unknown key, as in the hooks of a running skill; otherwise
        it logs an error and returns None.
    """

    def __init__(self, params: dict[str, Param] | None = None, is_strict: bool = False) -> None:
        self._params: dict[str, Param] = params if params is not None else {}
        self._is_strict = is_strict

    def __getitem__(self, key: str) -> Any:
        # Returns Any, so that `self.params["Speed"].value` passes a type check.
        param = self._params.get(key)
        if param is not None:
            return param
        if self._is_strict:
            raise self.unknown(key)
        return self.getParam(key)

    def __contains__(self, key: object) -> bool:
        return key in self._params

    def __len__(self) -> int:
        return len(self._params)

    def __iter__(self) -> Iterator[str]:
        return iter(self._params)

    def keys(self) -> KeysView[str]:
        return self._params.keys()

    def values(self) -> ValuesView[Param]:
        return self._params.values()

    def items(self) -> ItemsView[str, Param]:
        return self._params.items()

    def reset(self, copy: dict[str, Param] | ParamHandler) -> None:
        """Replaces the parameters by these; a dict is taken itself, not copied."""
        self._params = copy._params if isinstance(copy, ParamHandler) else copy

    def getCopy(self) -> dict[str, Param]:
        """Copies of the parameters by key; the values are shared."""
        return {key: param.clone() for key, param in self._params.items()}

    def getParamMap(self) -> dict[str, Param]:
        """The parameters by key, not a copy."""
        return self._params

    def merge(self, other: ParamHandler) -> dict[str, Param]:
        """Copies of the parameters with the values of `other`, and the remaining parameters of `other`.

        Omits parameters that are unset in `other`. Rejects values of another type with a logged error.
        """
        merged = self.getCopy()
        for key, param in other._params.items():
            if not param.current:
                merged.pop(key, None)
            elif key in merged:
                merged[key].setValues(param.values)
            else:
                merged[key] = param
        return merged

    def remap(self, initial_key: str, target_key: str) -> None:
        """Moves a parameter to another key and replaces the parameter there. Does nothing if the key is unknown."""
        moved = self._params.get(initial_key)
        if moved is None or initial_key == target_key:
            return
        self._params.pop(target_key, None)
        moved.key = target_key
        self._params = {param.key: param for param in self._params.values()}

    def specifyParams(self, other: ParamHandler, keep_default: bool = False) -> None:
        """Copies the values of `other` for the common keys; a parameter that is unset there becomes unset.

        Rejects values of another type with a logged error.

        :param keep_default: skip parameters with a default, unless it is an abstract element or has the same ids.
        """
        for key, param in self._params.items():
            given = other._params.get(key)
            if given is not None and not (keep_default and param.keeps_default(given.current)):
                param.setValues(given.values)

    def specifyParamsDefault(self, other: ParamHandler) -> None:
        """Copies the values of `other` for the common keys, also empty ones, and makes them the defaults."""
        for key, param in self._params.items():
            if key in other._params:
                param.makeDefault(other._params[key].values)

    def hasParam(self, key: str) -> bool:
        """Whether there is a parameter with the key."""
        return key in self._params

    def setDefault(self, key: str | list[str] | None = None) -> None:
        """Resets one, several or all parameters to the default.

        :raises UnknownName: unknown key.
        """
        keys = list(self._params) if key is None else [key] if isinstance(key, str) else key
        for param in [self._get(k) for k in keys]:
            param.setDefault()

    def addParam(
        self, key: str, value: Any, param_type: Any, description: str = "", limits: Limits = NO_LIMITS
    ) -> None:
        """Declares a parameter, or redefines it."""
        self._params[key] = Param(key, description, value, param_type, limits)
        local_revision.advance()

    def getParam(self, key: str) -> Param | None:
        """The parameter, or None with a logged error if the key is unknown."""
        param = self._params.get(key)
        if param is None:
            log.error("%s", self.unknown(key))
        return param

    def specifyDefault(self, key: str, values: Any) -> None:
        """Sets a parameter and its default. An unknown key is logged."""
        param = self.getParam(key)
        if param is not None:
            param.makeDefault(values)

    def specify(self, key: str, values: Any) -> None:
        """Sets a parameter; None unsets it. An unknown key and values of another type are logged."""
        param = self.getParam(key)
        if param is not None:
            param.setValues(values)

    def isSpecified(self, key: str) -> bool:
        """Whether the parameter has a value; an abstract element counts.

        :raises UnknownName: unknown key.
        """
        return self._get(key).isSpecified()

    def is_bound(self, key: str) -> bool:
        """Whether the parameter exists and has a value that is not an abstract element."""
        param = self._params.get(key)
        return param is not None and param.is_bound()

    def getParamValue(self, key: str) -> Any:
        """The first value, or None; an unknown key is logged."""
        param = self.getParam(key)
        return param.value if param is not None else None

    def getParamValues(self, key: str) -> Any:
        """All values, the list itself; None for an unknown key, which is logged."""
        param = self.getParam(key)
        return param.values if param is not None else None

    def getElementParams(self) -> dict[str, Param]:
        """The parameters whose current value is an element, by key."""
        return {key: param for key, param in self._params.items() if isinstance(param.value, Element)}

    def getParamMapFiltered(self, type_filter: Any) -> dict[str, Param]:
        """The parameters of one or several types, by key."""
        wanted = type_filter if isinstance(type_filter, (list, tuple, set)) else [type_filter]
        return {key: param for key, param in self._params.items() if param.paramType in wanted}

    def printState(self) -> str:
        """`key:[values] ` for each parameter; `key: id-label ` for an element."""
        return "".join(
            f"{key}: {param.value.printState()} " if isinstance(param.value, Element) else f"{param.printState()} "
            for key, param in self._params.items()
        )

    def _get(self, key: str) -> Param:
        param = self._params.get(key)
        if param is None:
            raise self.unknown(key)
        return param

    def unknown(self, key: str) -> UnknownName:
        """The error for an unknown key; it names the closest ones."""
        near = nearest(str(key), self._params)
        known = f"near: {', '.join(near)}" if near else f"there are: {', '.join(self._params) or 'none'}"
        return UnknownName(f"no parameter {key!r}; {known}")


def _is_abstract(value: Any) -> bool:
    return isinstance(value, Element) and value.isAbstract()


def _is_same(value: Any, default: Any) -> bool:
    if isinstance(value, Element) and isinstance(default, Element):
        return (value.id, value.type, value.label) == (default.id, default.type, default.label)
    return value is default or bool(value == default)


def _copied(value: Any) -> Any:
    """A copy of a value of a mutable type; another value itself."""
    if isinstance(value, Element):
        return value.as_read()
    return deepcopy(value) if isinstance(value, (dict, list, set)) else value
