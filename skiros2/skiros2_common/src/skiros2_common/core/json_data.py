"""JSON: parsing of untrusted texts, and the JSON form of dataclasses.

The fields of these dataclasses are strings, numbers, booleans, lists, dicts and such dataclasses.
"""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import asdict, fields
from typing import Any, Self, get_args, get_origin, get_type_hints

from skiros2_common.core.errors import WrongType, WrongValue

#: The maximum nesting depth of lists and dicts.
_MAX_DEPTH = 500
#: Strings (whose brackets do not count) and brackets.
_TOKENS = re.compile(r'"(?:[^"\\]|\\.)*"|[\[{\]}]', re.DOTALL)


def read_json(text: str) -> Any:
    """Parses a JSON text.

    :raises ValueError: the text is not JSON, or is nested too deeply.
    """
    # Python's parser recurses on the C stack: with a raised recursion limit (deep skill trees need one), deep nesting
    # would crash the process.
    if text.count("[") + text.count("{") > _MAX_DEPTH and _depth(text) > _MAX_DEPTH:
        raise ValueError("nested too deeply")
    return json.loads(text)


def _depth(text: str) -> int:
    brackets = (token for token in _TOKENS.findall(text) if len(token) == 1)
    return max(itertools.accumulate(1 if bracket in "[{" else -1 for bracket in brackets), default=0)


class JsonData:
    """Mixin that writes a dataclass as JSON and reads it again."""

    #: The name of the data in error messages.
    _data_name = "data"

    def to_dict(self) -> dict[str, Any]:
        """The data as dicts, lists, strings, numbers and booleans."""
        return asdict(self)  # type: ignore[call-overload, no-any-return]

    def to_json(self) -> str:
        return json.dumps(self.to_dict())

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """
        :raises WrongType: a value has another type than declared.
        :raises WrongValue: a field is missing or not declared.
        """
        read: Self = _read(cls, data, cls._data_name)
        return read

    @classmethod
    def from_json(cls, text: str) -> Self:
        """
        :raises WrongValue: the text is not JSON, or a field is missing or not declared.
        :raises WrongType: a value has another type than declared.
        """
        try:
            data = read_json(text)
        except ValueError as error:
            raise WrongValue(f"{cls._data_name}: {error}") from error
        return cls.from_dict(data)


def _read(declared: Any, data: Any, path: str) -> Any:
    """Converts JSON data to the declared type."""
    if get_origin(declared) is list:
        (item,) = get_args(declared)
        return [_read(item, value, f"{path}[{i}]") for i, value in enumerate(_checked(data, list, path))]
    if get_origin(declared) is dict:
        _, item = get_args(declared)
        return {key: _read(item, value, f"{path}.{key}") for key, value in _checked(data, dict, path).items()}
    if declared in (str, int, bool):
        return _checked(data, declared, path)
    if declared is float:
        return float(_checked(data, (int, float), path))
    types = get_type_hints(declared)
    unknown = _checked(data, dict, path).keys() - {f.name for f in fields(declared)}
    if unknown:
        raise WrongValue(f"{path}: {declared.__name__} has no field {', '.join(sorted(unknown))}")
    values = {key: _read(types[key], value, f"{path}.{key}") for key, value in data.items()}
    try:
        return declared(**values)
    except TypeError as error:
        raise WrongValue(f"{path}: {error}") from error


def _checked(data: Any, expected: Any, path: str) -> Any:
    if not isinstance(data, expected) or (isinstance(data, bool) and expected is not bool):
        name = getattr(expected, "__name__", "number")
        raise WrongType(f"{path}: expected a {name}, got {type(data).__name__}")
    return data
