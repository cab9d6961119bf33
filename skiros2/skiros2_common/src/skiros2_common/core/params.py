"""Parameters of skills, and the set of parameters that a skill has."""

from __future__ import annotations

import logging
import time as time_module
from collections.abc import Container, ItemsView, Iterator, KeysView, ValuesView
from copy import deepcopy
from enum import Enum
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.mutations import mutations
from skiros2_common.core.names import full_name
from skiros2_common.core.property import Property
from skiros2_common.core.world_element import Element

log = logging.getLogger(__name__)

ParamTypes = Enum("ParamTypes", "Required Optional Inferred")

#: How parameter types are written on the wire and in the world model.
PARAM_TYPE_CODES = {ParamTypes.Required: 0, ParamTypes.Optional: 1, ParamTypes.Inferred: 2}

_NOBODY: tuple[None, str] = (None, "")


class Param(Property):
    """A parameter: a property with a description, a type, and the default that it was declared with.

    :param value: a default, a Python type (no default), a list of one type, or an abstract `Element`.
    """

    def __init__(self, key: str, description: str, value: Any, param_type: Any) -> None:
        super().__init__(key, value)
        self._description = description
        self._param_type = param_type
        self._default: list[Any] = list(self._values)
        self._last_update = 0.0
        #: For the parameters of a running tree: values that a node below has put here, and its label.
        self.given_by: tuple[list[Any] | None, str] = _NOBODY

    @property
    def default(self) -> Any:
        """The first default value, or None."""
        return self._default[0] if self._default else None

    @property
    def defaults(self) -> list[Any]:
        """All default values."""
        return self._default

    @property
    def last_update(self) -> float:
        """When the values were last set (s since the epoch; 0.0: never)."""
        return self._last_update

    def hasChanges(self, time: Any, tolerance: float = 1) -> bool:
        """Whether the parameter was set since `time` (s since the epoch, or a ROS time).

        :param tolerance: ns by which a change has to be later to count.
        """
        since = time.to_sec() if hasattr(time, "to_sec") else float(time)
        return self._last_update > since + tolerance * 1e-9

    def _set(self, values: list[Any]) -> None:
        super()._set(values)
        self._last_update = time_module.time()

    def isSpecified(self) -> bool:
        """Whether there is a value; an abstract element is none."""
        return bool(self._values) and not _is_abstract(self._values[0])

    def hasSpecifiedDefault(self) -> bool:
        """Whether there is a default that is not an abstract element."""
        return bool(self._default) and not _is_abstract(self._default[0])

    def getDefaultValue(self, index: int = 0) -> Any:
        """The default at `index`, or None."""
        return self._default[index] if 0 <= index < len(self._default) else None

    def getDefaultValues(self) -> list[Any]:
        return self._default

    def hasDefaultValues(self) -> bool:
        return bool(self._default)

    def makeDefault(self, values: Any) -> None:
        """Sets the values and makes them the default.

        :raises WrongType: a value is of another type.
        """
        self.assign(values)
        self._default = list(self._values)

    def setDefault(self) -> None:
        """Sets the values back to the default."""
        self._set(self._new_default())

    def _new_default(self) -> list[Any]:
        # The skill may change what it gets: an abstract element, a dict. What was declared stays as it is.
        return [_own(v) for v in self._default]

    def at_default(self, is_set: bool = True) -> Param:
        """A copy that is set to the default, or unset."""
        copy = Param.__new__(Param)  # in the place of `clone`, since each start of a skill makes some
        copy._key = self._key
        copy._data_type = self._data_type
        copy._values = self._new_default() if is_set else []
        copy._description = self._description
        copy._param_type = self._param_type
        copy._default = self._default
        copy._last_update = time_module.time()
        copy.given_by = _NOBODY
        return copy

    @property
    def description(self) -> str:
        return self._description

    @property
    def paramType(self) -> Any:
        return self._param_type

    def paramTypeIs(self, ptype: Any) -> bool:
        return bool(self._param_type == ptype)

    @property
    def is_element(self) -> bool:
        """Whether the values are elements."""
        return issubclass(self._data_type, Element)

    @property
    def element_type(self) -> str:
        """The class that an element value has to be of, "" when the parameter does not say."""
        for value in (*self._default, *self._values):
            if isinstance(value, Element):
                return value.type
        return ""

    def toElement(self) -> Element:
        """The parameter as an element of the world model (type `skiros:Parameter`)."""
        element = Element("skiros:Parameter", self.key)
        element.setProperty("rdfs:comment", self._description)
        element.setProperty("skiros:ParameterType", PARAM_TYPE_CODES[self._param_type])
        # A class has its prefix, which tells it from a type of Python.
        datatype = full_name(self.element_type) if self.is_element else self._data_type.__name__
        element.setProperty("skiros:DataType", datatype)
        if self.is_element:
            for value in self._values:
                if not value.isAbstract():
                    element.addRelation("-1", "skiros:hasValue", value.id)
            return element
        if self._default and _is_plain(self._data_type):
            element.setProperty("skiros:Default", list(self._default))
        if self._values and _is_plain(self._data_type):
            element.setProperty("skiros:Value", list(self._values))
        return element


class ParamHandler:
    """The parameters of one skill, by key, in the order they were declared."""

    def __init__(self, params: dict[str, Param] | None = None) -> None:
        self._params: dict[str, Param] = params if params is not None else {}

    def __getitem__(self, key: str) -> Any:
        # Any, so that an author's `self.params["Speed"].value` passes a type check.
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
        """Takes a copy of these parameters in the place of its own."""
        source = copy._params if isinstance(copy, ParamHandler) else copy
        self._params = {key: param.clone() for key, param in source.items()}  # type: ignore[misc]

    def getCopy(self) -> dict[str, Param]:
        """A copy of the parameters by key."""
        return {key: param.clone() for key, param in self._params.items()}  # type: ignore[misc]

    def at_defaults(self, but: Container[str] = ()) -> ParamHandler:
        """A copy in which each parameter is set to its default.

        :param but: those that are unset instead, for they are to be set to something else.
        """
        return ParamHandler({key: param.at_default(key not in but) for key, param in self._params.items()})

    def getParamMap(self) -> dict[str, Param]:
        """The parameters by key, not a copy."""
        return self._params

    def merge(self, other: ParamHandler) -> None:
        """Takes over the parameters of `other`; one that `other` has unset is dropped."""
        for key, param in other._params.items():
            if param.values:
                self._params[key] = param.clone()  # type: ignore[assignment]
            else:
                self._params.pop(key, None)

    def remap(self, initial_key: str, target_key: str) -> None:
        """Renames a key, which keeps its place.

        :raises UnknownName: there is no such key.
        """
        if initial_key not in self._params:
            raise self._unknown(initial_key)
        renamed = self._params[initial_key].clone()
        renamed._key = target_key
        self._params = {
            (target_key if key == initial_key else key): (renamed if key == initial_key else param)  # type: ignore[misc]
            for key, param in self._params.items()
            if key == initial_key or key != target_key
        }

    def specifyParams(self, other: ParamHandler, keep_default: bool = False) -> None:
        """Takes the values that `other` has for the keys of this one.

        :param keep_default: a parameter with a default that is not an abstract element keeps its value.
        :raises WrongType: a value is of another type.
        """
        for key, param in self._params.items():
            if keep_default and param.hasSpecifiedDefault():
                continue
            if key in other._params and other._params[key].values:
                param.assign(list(other._params[key].values))

    def specifyParamsDefault(self, other: ParamHandler) -> None:
        """Takes the values that `other` has for the keys of this one, and makes them the defaults."""
        for key, param in self._params.items():
            if key in other._params and other._params[key].values:
                param.makeDefault(list(other._params[key].values))

    def hasParam(self, key: str) -> bool:
        return key in self._params

    def setDefault(self, key: str | None = None) -> None:
        """Sets one parameter, or all, back to the default."""
        for param in self._params.values() if key is None else [self._get(key)]:
            param.setDefault()

    def addParam(self, key: str, value: Any, param_type: Any, description: str = "") -> None:
        """Declares a parameter; one of that key is redefined."""
        self._params[key] = Param(key, description, value, param_type)
        mutations.note()

    def getParam(self, key: str) -> Param | None:
        """The parameter, or None, with a logged error, when there is none of that key."""
        param = self._params.get(key)
        if param is None:
            log.error("%s", self._unknown(key))
        return param

    def specifyDefault(self, key: str, values: Any) -> None:
        """Sets a parameter and makes the values its default.

        :raises UnknownName: there is no such key.
        :raises WrongType: a value is of another type.
        """
        self._get(key).makeDefault(values)

    def specify(self, key: str, values: Any) -> None:
        """Sets a parameter.

        :raises UnknownName: there is no such key.
        :raises WrongType: a value is of another type.
        """
        self._get(key).assign(values)

    def isSpecified(self, key: str) -> bool:
        """Whether the parameter is there and has a value that is not an abstract element."""
        param = self._params.get(key)
        return param is not None and param.isSpecified()

    def getParamValue(self, key: str) -> Any:
        """The first value, or None.

        :raises UnknownName: there is no such key.
        """
        return self._get(key).value

    def getParamValues(self, key: str) -> list[Any]:
        """All values.

        :raises UnknownName: there is no such key.
        """
        return self._get(key).values

    def getElementParams(self) -> list[Param]:
        """The parameters whose values are elements."""
        return [param for param in self._params.values() if param.is_element]

    def getParamMapFiltered(self, type_filter: Any) -> dict[str, Param]:
        """The parameters of one type, or several."""
        wanted = type_filter if isinstance(type_filter, (list, tuple, set)) else [type_filter]
        return {key: param for key, param in self._params.items() if param.paramType in wanted}

    def printState(self) -> str:
        """`key:[values] ` of each parameter."""
        return "".join(f"{param.printState()} " for param in self._params.values())

    def _get(self, key: str) -> Param:
        param = self._params.get(key)
        if param is None:
            raise self._unknown(key)
        return param

    def _unknown(self, key: str) -> UnknownName:
        return UnknownName(f"no parameter {key!r}; there are: {', '.join(self._params) or 'none'}")


def _is_abstract(value: Any) -> bool:
    return isinstance(value, Element) and value.isAbstract()


def _own(value: Any) -> Any:
    """A value that may be changed in place, with a copy in its place."""
    if isinstance(value, Element):
        return value.view()
    return deepcopy(value) if isinstance(value, (dict, list, set)) else value


def _is_plain(datatype: type) -> bool:
    return datatype in (str, int, float, bool)
