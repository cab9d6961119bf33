"""Dataclasses of plain values that travel as JSON: texts, numbers, truth values, lists, dicts and others such."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from skiros2_common.core.errors import WrongType, WrongValue
from skiros2_common.core.json_text import read_json

Self = TypeVar("Self", bound="JsonData")


class JsonData:
    """What a dataclass inherits to be written as JSON and read again."""

    #: What it is called in error messages.
    _called = "data"

    def to_dict(self) -> dict[str, Any]:
        """It as JSON has it: dicts, lists, texts and numbers."""
        return asdict(self)  # type: ignore[call-overload, no-any-return]

    def to_json(self) -> str:
        return json.dumps(self.to_dict())

    @classmethod
    def from_dict(cls: type[Self], data: Any) -> Self:
        """
        :raises WrongType: something is of another type than declared.
        :raises WrongValue: something is missing, or is not declared.
        """
        made: Self = _read(cls, data, cls._called)
        return made

    @classmethod
    def from_json(cls: type[Self], text: str) -> Self:
        """
        :raises WrongValue: the text is no JSON, or something is missing or not declared.
        :raises WrongType: something is of another type than declared.
        """
        try:
            data = read_json(text)
        except ValueError as error:
            raise WrongValue(f"{cls._called}: {error}") from error
        return cls.from_dict(data)


def _read(declared: Any, data: Any, place: str) -> Any:
    """The value of a declared type that JSON data stand for."""
    if get_origin(declared) is list:
        (item,) = get_args(declared)
        return [_read(item, value, f"{place}[{i}]") for i, value in enumerate(_checked(data, list, place))]
    if get_origin(declared) is dict:
        _, item = get_args(declared)
        return {key: _read(item, value, f"{place}.{key}") for key, value in _checked(data, dict, place).items()}
    if declared in (str, int, bool):
        return _checked(data, declared, place)
    if declared is float:
        return float(_checked(data, (int, float), place))
    types = get_type_hints(declared)
    unknown = _checked(data, dict, place).keys() - {f.name for f in fields(declared)}
    if unknown:
        raise WrongValue(f"{place}: {', '.join(sorted(unknown))} is no part of {declared.__name__}")
    values = {key: _read(types[key], value, f"{place}.{key}") for key, value in data.items()}
    try:
        return declared(**values)
    except TypeError as error:
        raise WrongValue(f"{place}: {error}") from error


def _checked(data: Any, expected: Any, place: str) -> Any:
    if not isinstance(data, expected) or (isinstance(data, bool) and expected is not bool):
        name = getattr(expected, "__name__", "number")
        raise WrongType(f"{place}: expected a {name}, got {type(data).__name__}")
    return data
