"""A property: a key with a list of values of one type."""

from __future__ import annotations

import logging
import numbers
import reprlib
from collections.abc import Sequence
from sys import intern
from typing import Any

from skiros2_common.core.errors import UnknownName, WrongType, WrongValue
from skiros2_common.core.mutations import mutations

log = logging.getLogger(__name__)

_TRUE_TEXTS = ("true", "1")
_FALSE_TEXTS = ("false", "0")

_shown = reprlib.Repr()
_shown.maxstring = _shown.maxother = _shown.maxlong = 200


def as_type(value: Any, datatype: type) -> Any:
    """`value` as a `datatype`, where nothing is lost by it (int to float, NumPy numbers to Python's).

    :raises WrongType: it is of another type.
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
    raise WrongType(f"expected a value of type {datatype.__name__}, got {type(value).__name__} {shown(value)}")


def is_bool(value: Any) -> bool:
    """Whether a value is a bool of Python or of NumPy."""
    return isinstance(value, bool) or (
        type(value).__module__ == "numpy" and type(value).__name__ in ("bool_", "bool")
    )


def shown(value: Any) -> str:
    """A value in the text of an error: short, however long or deep it is."""
    return _shown.repr(value)


def from_text(text: str, datatype: type) -> Any:
    """The value of a `datatype` that `text` writes ("False" is False).

    :raises WrongValue: the text is no such value.
    """
    if datatype is bool:
        if text.strip().lower() in _TRUE_TEXTS:
            return True
        if text.strip().lower() in _FALSE_TEXTS:
            return False
        raise WrongValue(f"expected True or False, got {shown(text)}")
    try:
        return datatype(text)
    except (TypeError, ValueError) as error:
        raise WrongValue(f"{shown(text)} is no {datatype.__name__}") from error


def same_value(one: Any, other: Any) -> bool:
    """Whether two values are equal; numbers and bools equal their text, as scenes in the field write them."""
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
    """A key with a list of values, all of the type that the first one, or a given Python type, fixed.

    The setters refuse a value of another type: they log an error and change nothing. `assign` raises instead.

    :param key: the name, such as `skiros:PositionX`.
    :param value: a Python type (no value yet), one value, or a list of values of one type.
    """

    __slots__ = ("_data_type", "_key", "_values")

    def __init__(self, key: str, value: Any) -> None:
        self._key = intern(key)  # a scene has many of one key
        self._values: list[Any] = []
        if isinstance(value, type):
            self._data_type: type = value
        elif isinstance(value, list):
            if not value:
                self._data_type = list
            elif isinstance(value[0], type):
                self._data_type = value[0]
            else:
                self._data_type = type(value[0])
                self._values = self._checked(value)
        elif value is None:
            self._data_type = str
        else:
            self._data_type = type(value)
            self._values = [value]

    def clone(self) -> Property:
        """A copy with a value list of its own (the values themselves are shared)."""
        clone = self.__class__.__new__(self.__class__)
        clone._key = self._key
        clone._data_type = self._data_type
        clone._values = list(self._values)
        more = getattr(self, "__dict__", None)  # what a subclass has beside
        if more:
            clone.__dict__.update(more)
        return clone

    def isSpecified(self) -> bool:
        """Whether there is a value."""
        return bool(self._values)

    def isList(self) -> bool:
        """Whether there are several values."""
        return len(self._values) > 1

    @property
    def key(self) -> str:
        return self._key

    @property
    def value(self) -> Any:
        """The first value, or None."""
        return self._values[0] if self._values else None

    @value.setter
    def value(self, value: Any) -> None:
        self.setValue(value)

    @property
    def values(self) -> list[Any]:
        """All values."""
        return self._values

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
        """Whether the values are of that type (a type, or a value of it)."""
        wanted = vtype if isinstance(vtype, type) else type(vtype)
        return issubclass(self._data_type, wanted)

    def unset(self) -> None:
        """Removes all values."""
        self._set([])

    def assign(self, value: Any) -> None:
        """Sets all values, from a list or one value; None removes all.

        :raises WrongType: a value is of another type; nothing has changed then.
        """
        self._set([] if value is None else self._checked(self._as_list(value)))

    def setValue(self, value: Any, index: int = 0) -> None:
        """Sets the value at `index`; the index after the last one adds it. None removes all values."""
        if value is None:
            self.unset()
            return
        if not 0 <= index <= len(self._values):
            log.error("%s: no value at index %s, there are %s", self._key, index, len(self._values))
            return
        checked = self._checked_or_log([value])
        if checked:
            self._set([*self._values[:index], checked[0], *self._values[index + 1 :]])

    def setValueFromStr(self, value: str, index: int = 0) -> None:
        """Sets the value at `index` from its text. An unusable text is refused with a logged error."""
        try:
            self.setValue(from_text(value, self._data_type), index)
        except WrongValue as error:
            log.error("%s: %s", self._key, error)

    def setValuesFromStr(self, values: Sequence[str]) -> None:
        """Sets all values from their texts. With an unusable one nothing changes, and an error is logged."""
        try:
            self.setValues([from_text(v, self._data_type) for v in values])
        except WrongValue as error:
            log.error("%s: %s", self._key, error)

    def setValues(self, value: Any) -> None:
        """Sets all values, from a list or one value; None removes all."""
        if value is None:
            self.unset()
            return
        checked = self._checked_or_log(self._as_list(value))
        if checked is not None:
            self._set(checked)

    def removeValue(self, value: Any) -> None:
        """Removes the first such value.

        :raises WrongValue: there is none.
        """
        index = self.find(value)
        if index < 0:
            raise WrongValue(f"{self._key}: no value {value!r} among {self._values!r}")
        self._set([*self._values[:index], *self._values[index + 1 :]])

    def find(self, value: Any) -> int:
        """The index of the first such value, or -1."""
        return self._values.index(value) if value in self._values else -1

    def addValue(self, value: Any) -> None:
        """Adds a value at the end."""
        self.setValue(value, len(self._values))

    def getValue(self, index: int = 0) -> Any:
        """The value at `index`, or None when there is no value at all.

        :raises UnknownName: there are values, but none at that index.
        """
        if not self._values:
            return None
        if not 0 <= index < len(self._values):
            raise UnknownName(f"{self._key}: no value at index {index}, there are {len(self._values)}")
        return self._values[index]

    def getValues(self) -> list[Any]:
        """All values."""
        return self._values

    def getValuesStr(self) -> list[str]:
        """All values as texts, as `setValuesFromStr` takes them."""
        return [str(v) for v in self._values]

    def printState(self) -> str:
        """`key:[values]`."""
        return f"{self._key}:{self._values}"

    def __repr__(self) -> str:
        return self.printState()

    def _set(self, values: list[Any]) -> None:
        """Every change of the values ends here. The list is a new one each time, which shows that it has changed."""
        self._values = values
        mutations.note()

    def _as_list(self, value: Any) -> list[Any]:
        if not isinstance(value, (list, tuple)):
            return [value]
        if self._data_type in (list, tuple) and not all(isinstance(v, (list, tuple)) for v in value):
            return [value]
        return list(value)

    def _checked(self, values: Sequence[Any]) -> list[Any]:
        try:
            if len(values) == 1:
                return [as_type(values[0], self._data_type)]  # in less memory than a comprehension makes
            return [as_type(v, self._data_type) for v in values]
        except WrongType as error:
            raise WrongType(f"{self._key}: {error}") from None

    def _checked_or_log(self, values: Sequence[Any]) -> list[Any] | None:
        try:
            return self._checked(values)
        except WrongType as error:
            log.error("%s. It stays %s.", error, self._values)
            return None
