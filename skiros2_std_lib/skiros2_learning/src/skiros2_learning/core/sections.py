"""Sections of nested data, such as a YAML file: frozen dataclasses that pydantic reads, with all mistakes at once."""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    TypeAdapter,
    ValidationError,
)
from pydantic_core import InitErrorDetails, PydanticCustomError, core_schema

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.names import nearest

T = TypeVar("T")

# YAML has types: a text of digits is no number, and true is none.
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0.0)]
NotNegative = Annotated[Number, Field(ge=0.0)]
Whole = Annotated[int, Field(strict=True)]
Natural = Annotated[Whole, Field(ge=0)]
Count = Annotated[Whole, Field(ge=1)]
Text = Annotated[str, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]
#: Under this key, a section in `Named` has its key.
_KEY = ""
Name = Annotated[str, Field(alias=_KEY)]

_EXPECTED = {
    "string_type": "a text",
    "bool_type": "true or false",
    "int_type": "an integer",
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "tuple_type": "a list",
    "dict_type": "keys and values",
    "greater_than": "more than {gt:g}",
    "greater_than_equal": "at least {ge:g}",
    "less_than_equal": "at most {le:g}",
}

#: The path of a key in a section, and what is wrong there.
Mistake = tuple[tuple[str | int, ...], str]


_adapter: Callable[[Any], TypeAdapter[Any]] = functools.cache(TypeAdapter)


class UnknownNames(UnknownName):
    """Several names are unknown.

    :param problems: by name, a text for each.
    """

    def __init__(self, problems: Mapping[str, str]) -> None:
        super().__init__("; ".join(problems.values()))
        self.problems = problems


class Section:
    """Base of a dataclass that is a section of the data. A key without a value (null) counts as absent.

    Only `read` checks: a program may make a section of any values.
    """

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", arbitrary_types_allowed=True)

    @classmethod
    def completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Returns the data of the section with defaults that depend on other keys."""
        return data

    @classmethod
    def mistakes(cls, data: Mapping[str, Any]) -> Iterable[Mistake]:
        """Yields what is wrong between keys of the section.

        :param data: as in the file: each key may be missing, and have a value of any type.
        """
        return ()

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        schema: Any = dict(handler.resolve_ref_schema(handler(source)))
        ref = schema.pop("ref", None)  # the class stands for what is returned
        names = [each.get("validation_alias", each["name"]) for each in schema["schema"]["fields"]]
        keys = [name for name in names if name != _KEY]
        return core_schema.no_info_wrap_validator_function(functools.partial(_read, cls, keys), schema, ref=ref)


def read(cls: type[T], data: Any, context: Any = None) -> T:
    """Reads data as an object of a class.

    :param context: for validators, as `info.context`.
    :raises ValidationError: with all mistakes; see `mistakes_of`.
    """
    made: T = _adapter(cls).validate_python(data, context=context)
    return made


def mistakes_of(error: ValidationError, *where: str) -> list[Mistake]:
    """Returns the mistakes that `read` has found: the path of each, and a line of text that begins with it.

    :param where: path of the data.
    """
    found = [((*where, *each["loc"]), each["msg"]) for each in error.errors(include_url=False)]
    return [(path, f"{path_text(path)}: {text}") for path, text in found]


def near(name: str, known: Collection[str]) -> str:
    """Returns a hint: the known names nearest to an unknown one, or all."""
    close = nearest(name, known)
    return f"near: {', '.join(close)}" if close else f"there are: {', '.join(sorted(known)) or 'none'}"


def numbers(values: Any) -> list[float]:
    """Returns the finite numbers in a value of any type: those of a list, or itself."""
    parts = values if isinstance(values, list | tuple) else [values]
    return [float(v) for v in parts if isinstance(v, int | float) and not isinstance(v, bool) and abs(v) < 1e300]


def _read(
    cls: type[Section], keys: Collection[str], data: Any, handler: core_schema.ValidatorFunctionWrapHandler
) -> Any:
    if not isinstance(data, Mapping | None):
        raise mistaken([((), f"expected keys and values, got {data!r}")])
    given = cls.completed({str(key): value for key, value in (data or {}).items() if value is not None})
    found = [*cls.mistakes(given)]
    try:
        made = handler(given)
    except ValidationError as error:
        found += [_described(each, keys) for each in error.errors(include_url=False)]
    if found:
        raise mistaken(found)
    return made


def mistaken(mistakes: Iterable[Mistake]) -> ValidationError:
    """Returns an error with several mistakes, for a validator to raise."""
    return ValidationError.from_exception_data(
        "section",
        [InitErrorDetails(type=PydanticCustomError("section", text), loc=loc, input=None) for loc, text in mistakes],
    )


def _described(error: Any, keys: Collection[str]) -> Mistake:
    """Describes an error of pydantic. An item of a list of values has the path of the list."""
    loc = error["loc"]
    if error["type"] != "section" and loc and isinstance(loc[-1], int):
        loc = loc[:-1]
    return loc, _text(error, keys)


def _text(error: Any, keys: Collection[str]) -> str:
    kind, details = error["type"], error.get("ctx", {})
    if kind == "missing":
        return "missing"
    if kind == "unexpected_keyword_argument":
        return f"unknown key; {near(error['loc'][-1], keys)}"
    if kind == "literal_error":
        known = re.findall("'(.+?)'", details["expected"])
        return f"unknown: {error['input']!r}; {near(str(error['input']), known)}"
    if kind in _EXPECTED:
        return f"expected {_EXPECTED[kind].format(**details)}, got {error['input']!r}"
    return str(details.get("error", error["msg"]))


def path_text(parts: Iterable[str | int]) -> str:
    """Returns a path such as `objectives.cost.rewards[0].weight`."""
    path = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts)
    return path.strip(".") or "scenario"


class _ByName:
    """Reads sections by name: each key of the mapping is the `name` of its section."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> core_schema.CoreSchema:
        sections = core_schema.dict_schema(core_schema.str_schema(), handler.generate_schema(get_args(source)[0]))
        named = core_schema.no_info_before_validator_function(_with_names, sections)
        return core_schema.no_info_after_validator_function(lambda found: tuple(found.values()), named)


def _with_names(data: Any) -> Any:
    if not isinstance(data, Mapping):
        return data
    sections = {str(key): {} if section is None else section for key, section in data.items()}
    return {key: {**each, _KEY: key} if isinstance(each, Mapping) else each for key, each in sections.items()}


def _some(values: T) -> T:
    if not values:
        raise ValueError("none; expected at least one")
    return values


def _with_text_keys(data: Any) -> Any:
    return {str(key): value for key, value in data.items()} if isinstance(data, Mapping) else data


def _bounds(data: Any) -> Any:
    if isinstance(data, list) and len(data) != 2:
        raise ValueError(f"expected 2 numbers, got {len(data)}")
    if len(limits := numbers(data)) == 2 and limits[0] >= limits[1]:
        raise ValueError(f"expected the lower bound first, got [{limits[0]:g}, {limits[1]:g}]")
    return data


Some = AfterValidator(_some)
Named = Annotated[tuple[T, ...], _ByName()]
Keyed = Annotated[dict[str, T], BeforeValidator(_with_text_keys)]
Range = Annotated[tuple[Number, Number], BeforeValidator(_bounds)]
