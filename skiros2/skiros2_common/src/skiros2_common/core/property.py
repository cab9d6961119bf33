"""A property: a key with a list of values of one type."""

from __future__ import annotations

import logging
import numbers
import reprlib
from ast import literal_eval
from operator import is_
from sys import intern
from typing import Any

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.revision import local_revision

log = logging.getLogger(__name__)

_TRUE_TEXTS = ("true", "1")
_FALSE_TEXTS = ("false", "0")

#: The maximum number of characters in `printState`.
MAX_PRINTED = 500

_formatter = reprlib.Repr()
_formatter.maxstring = _formatter.maxother = _formatter.maxlong = 200


def as_type(value: Any, datatype: type) -> Any:
    """Converts `value` to `datatype` without loss (int to float, NumPy numbers to Python numbers).

    :raises WrongType: the value has another type.
    """
    if type(value) is datatype:
        return value
    if datatype is float:
        if isinstance(value, numbers.Real) and not isinstance(value, bool):
            try:
                return float(value)
            except OverflowError:
                raise WrongType("expected a value of type float, got a whole number that is too large") from None
    elif datatype is int:
        if isinstance(value, numbers.Integral) and not isinstance(value, bool):
            return int(value)
    elif datatype is bool:
        if is_bool(value):
            return bool(value)
    elif isinstance(value, datatype):
        return value
    raise WrongType(f"expected a value of type {datatype.__name__}, got {type(value).__name__} {format_value(value)}")


def is_bool(value: Any) -> bool:
    """Whether a value is a Python or NumPy bool."""
    return isinstance(value, bool) or (type(value).__module__ == "numpy" and type(value).__name__ in ("bool_", "bool"))


def format_value(value: Any) -> str:
    """Formats a value for people; abbreviates long and deeply nested values."""
    return _formatter.repr(value)


def from_text(text: str, datatype: type) -> Any:
    """Parses a value of type `datatype` ("False" gives False).

    :raises WrongValue: the text does not represent such a value.
    """
    if datatype is bool:
        if text.strip().lower() in _TRUE_TEXTS:
            return True
        if text.strip().lower() in _FALSE_TEXTS:
            return False
        raise WrongValue(f"expected True or False, got {format_value(text)}")
    try:
        if datatype is dict:
            return dict(literal_eval(text))
        return datatype(text)
    except (TypeError, ValueError, SyntaxError) as error:
        raise WrongValue(f"{format_value(text)} is not a valid {datatype.__name__}") from error


def same_value(one: Any, other: Any) -> bool:
    """Whether two values are equal; a number or bool equals its text, because existing scenes mix both."""
    if type(one) is type(other):
        return bool(one == other)
    if isinstance(one, str) != isinstance(other, str):
        text, value = (one, other) if isinstance(one, str) else (other, one)
        if not isinstance(value, (bool, int, float)):
            return False
        try:
            return bool(from_text(text, type(value)) == value)
        except WrongValue:
            return False
    if isinstance(one, bool) != isinstance(other, bool):
        return False
    return bool(one == other)


class Property:
    """A key with a list of values of one type.

    The list is returned itself, not copied: changes in place change the property. Setters reject a value of another
    type: they log an error and change nothing. `assign` raises instead.

    :param key: the name, such as `skiros:PositionX`.
    :param value: a Python type (no value yet), one value, or a list of values of one type.
    :raises WrongValue: the list has values of several types.
    """

    __slots__ = ("_data_type", "current", "key")

    def __init__(self, key: str, value: Any) -> None:
        #: The name.
        self.key = intern(key)  # a scene repeats the same keys
        #: The list of values itself. Those who may change it in place use `values`, which a parameter keeps track of.
        self.current: list[Any] = []
        if isinstance(value, type):
            self._data_type: type = value
        elif isinstance(value, list):
            if not value:
                self._data_type = list
            elif isinstance(value[0], type):
                self._data_type = value[0]
            else:
                self._data_type = type(value[0])
                try:
                    self.current = list(self.checked(value))
                except WrongType as error:
                    raise WrongValue(f"{error}: the values of a list must have one type") from None
        elif value is None:
            self._data_type = str
        else:
            self._data_type = type(value)
            self.current = [value]

    def clone(self) -> Property:
        """A copy with its own value list (the values themselves are shared)."""
        clone = self.__class__.__new__(self.__class__)
        clone.key = self.key
        clone._data_type = self._data_type
        clone.current = list(self.current)
        return clone

    def isSpecified(self) -> bool:
        """Whether there is a value."""
        return bool(self.current)

    def isList(self) -> bool:
        """Whether there are several values."""
        return len(self.current) > 1

    @property
    def value(self) -> Any:
        """The first value, or None."""
        return self.current[0] if self.current else None

    @value.setter
    def value(self, value: Any) -> None:
        self.setValue(value)

    @property
    def values(self) -> list[Any]:
        """All values: the list itself, no copy."""
        return self.current

    @values.setter
    def values(self, value: Any) -> None:
        self.setValues(value)

    def makeInstance(self) -> Any:
        """A new default value of the property's type."""
        return self._data_type()

    def dataType(self) -> type:
        """The Python type of the values."""
        return self._data_type

    def dataTypeIs(self, vtype: Any) -> bool:
        """Whether the data type is exactly this type or, given a value, whether the value has the data type."""
        return self._data_type is vtype if isinstance(vtype, type) else isinstance(vtype, self._data_type)

    def unset(self) -> None:
        """Removes all values by assigning a new empty list."""
        self._set([])

    def assign(self, value: Any) -> None:
        """Sets all values, from a list, a tuple or one value; None removes all.

        :raises WrongType: a value has another type; the property is unchanged.
        """
        self._set([] if value is None else list(self.checked(self._as_list(value))))

    def setValue(self, value: Any, index: int = 0) -> None:
        """Sets the value at `index`, in the same list. A negative index counts from the end; an index past the end
        appends the value. None is rejected with a logged error."""
        values = self.current
        if value is None:
            log.error("%s: None is not allowed; unset() removes the values", self.key)
        elif index < -len(values):
            log.error("%s: no value at index %s, there are %s", self.key, index, len(values))
        else:
            checked = self.checked_or_log([value])
            if checked and index < len(values):
                values[index] = checked[0]
            elif checked:
                values.append(checked[0])
        self._record_set()

    def setValueFromStr(self, value: str, index: int = 0) -> None:
        """Sets the value at `index` from its text; a dict from a Python literal.

        :raises WrongValue: the text does not represent such a value.
        """
        self.setValue(from_text(value, self._data_type), index)

    def setValuesFromStr(self, values: str) -> None:
        """Sets all values from a text separated by `;`; "" removes all.

        :raises WrongValue: a part does not represent such a value; the property is unchanged.
        """
        found = [from_text(item, self._data_type) for item in values.split(";")] if values else []
        self.unset()
        for index, item in enumerate(found):
            self.setValue(item, index)

    def setValues(self, value: Any) -> None:
        """Sets all values to a list (taken itself, not copied) or one value; None removes all.

        A tuple and values of another type are rejected with a logged error.
        """
        if value is None:
            self._set([])
            return
        is_one_list = self._data_type is list and isinstance(value, list) and not all(type(v) is list for v in value)
        checked = self.checked_or_log(value if isinstance(value, list) and not is_one_list else [value])
        if checked is not None:
            self._set(checked)

    def removeValue(self, value: Any) -> None:
        """Removes the first equal value, if any."""
        index = self.find(value)
        if index >= 0:
            del self.current[index]
        self._record_set()

    def find(self, value: Any) -> int:
        """The index of the first equal value, or -1."""
        return self.current.index(value) if value in self.current else -1

    def addValue(self, value: Any) -> None:
        """Appends a value."""
        self.setValue(value, len(self.current))

    def getValue(self, index: int = 0) -> Any:
        """The value at `index` (negative: from the end), or None if there is no value.

        :raises IndexError: there are values, but none at this index.
        """
        if not self.current:
            return None
        try:
            return self.current[index]
        except IndexError:
            raise IndexError(f"{self.key}: no value at index {index}, there are {len(self.current)}") from None

    def getValues(self) -> list[Any]:
        """All values: the list itself, no copy."""
        return self.values

    def getValuesStr(self) -> str:
        """All values as one text, in the form of `setValuesFromStr`."""
        return ";".join(str(v) for v in self.current)

    def printState(self) -> str:
        """`key:[values]`; the values are cut at 500 characters."""
        text = str(self.current)
        return f"{self.key}:{text}" if len(text) <= MAX_PRINTED else f"{self.key}:{text[:MAX_PRINTED]} ...]"

    def __repr__(self) -> str:
        return self.printState()

    def _set(self, values: list[Any]) -> None:
        """Replaces the value list."""
        self.current = values
        self._record_set()

    def _record_set(self) -> None:
        """Records the call of a setter, also of one that changed nothing."""
        local_revision.advance()

    def _as_list(self, value: Any) -> list[Any]:
        if not isinstance(value, (list, tuple)):
            return [value]
        if self._data_type in (list, tuple) and not all(isinstance(v, (list, tuple)) for v in value):
            return [value]
        return list(value)

    def checked(self, values: list[Any]) -> list[Any]:
        """The values converted to the data type; the list itself if no value needs a conversion.

        :raises WrongType: a value has another type.
        """
        datatype = self._data_type
        if len(values) == 1 and type(values[0]) is datatype:
            return values
        try:
            converted_property = [as_type(v, datatype) for v in values]
        except WrongType as error:
            raise WrongType(f"{self.key}: {error}") from None
        return values if all(map(is_, converted_property, values)) else converted_property

    def checked_or_log(self, values: list[Any]) -> list[Any] | None:
        """Same as `checked`; values of another type are logged and give None."""
        if len(values) == 1 and type(values[0]) is self._data_type:
            return values
        try:
            if self._data_type is int and bool in map(type, values):  # Python's bool is a subclass of int
                values = [int(v) if type(v) is bool else v for v in values]
            return self.checked(values)
        except WrongType as error:
            log.error("%s. The values stay %s.", error, self.current)
            return None


#: The Python types of the XSD datatypes that `Element.setProperty` accepts.
DATATYPES: dict[str, type] = {
    "xsd:float": float,
    "xsd:double": float,
    "xsd:decimal": float,
    "xsd:int": int,
    "xsd:integer": int,
    "xsd:boolean": bool,
    "xsd:string": str,
}


def converted_property(key: str, value: Any, datatype: type) -> Property:
    """A property of type `datatype` with the converted value or values.

    :raises WrongValue: a value cannot be converted.
    """
    prop = Property(key, datatype)
    if value is not None and not isinstance(value, type):
        prop.assign([_convert(key, v, datatype) for v in (value if isinstance(value, (list, tuple)) else [value])])
    return prop


def _convert(key: str, value: Any, datatype: type) -> Any:
    try:
        return from_text(value, datatype) if isinstance(value, str) else as_type(value, datatype)
    except (WrongValue, WrongType):
        try:
            return datatype(value)
        except (TypeError, ValueError) as error:
            raise WrongValue(f"{key}: {value!r} cannot be made a {datatype.__name__}") from error
