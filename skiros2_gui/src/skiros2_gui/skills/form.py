"""The start form of a skill: parameters with the user's values."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from enum import Enum
from typing import Any

from skiros2_common.core.errors import SkirosError, UnknownName, WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.limits import Limits
from skiros2_common.core.names import ANY_TYPE, full_name, local_name
from skiros2_common.core.world_element import Element
from skiros2_gui.skills.catalogue import Offer
from skiros2_skill.client.description import Parameter, Step
from skiros2_skill.command_line.assignments import read_values
from skiros2_task.core.actions import ROBOT_KEY


class Editor(Enum):
    """The kinds of editors."""

    ELEMENT = "element"
    TEXT = "text"
    NUMBER = "number"
    TRUTH = "yes or no"
    CHOICE = "one of some values"
    JSON = "JSON"


class ValueMode(Enum):
    """How a parameter gets its value."""

    GIVEN = "given"
    INFER = "infer"
    UNSET = "unset"


#: By wire type; all other types are edited as JSON.
_EDITORS = {"str": Editor.TEXT, "int": Editor.NUMBER, "float": Editor.NUMBER, "bool": Editor.TRUTH}

_TYPE_NAMES = {
    "str": "text",
    "int": "whole number",
    "float": "number",
    "bool": "yes or no",
    "list": "list",
    "dict": "mapping",
}

_EXAMPLES = {"list": "[1, 2]", "dict": '{"name": 1}'}


@dataclass(frozen=True)
class ElementChoice:
    """An element that a parameter may hold."""

    id: str
    label: str
    type: str = ""


@dataclass
class Field:
    """A parameter and the user's value.

    :param declared: the declaration.
    :param mode: one of `modes`.
    :param text: the text of the editor, except for elements and booleans.
    :param value: the element's id, or the boolean.
    :param error: why the value is invalid; "" if it is valid.
    """

    declared: Parameter
    mode: ValueMode = dataclass_field(default=ValueMode.GIVEN, init=False)
    text: str = dataclass_field(default="", init=False)
    value: Any = dataclass_field(default=None, init=False)
    error: str = dataclass_field(default="", init=False)

    def __post_init__(self) -> None:
        self.reset()

    # -- declaration -------------------------------------------------------------------------------------------

    @property
    def key(self) -> str:
        return self.declared.key

    @property
    def editor(self) -> Editor:
        if self.declared.is_element:
            return Editor.ELEMENT
        if len(self.declared.default) > 1:
            return Editor.JSON  # several values are edited as a list
        found = _EDITORS.get(self.declared.wire_type, Editor.JSON)
        return Editor.CHOICE if self.limits.choices and found in (Editor.TEXT, Editor.NUMBER) else found

    @property
    def element_class(self) -> str:
        """The required class of an element; "" for any."""
        name = self.declared.type if self.declared.is_element else ""
        return "" if name in (*ANY_TYPE, "element") else full_name(name)

    @property
    def type_name(self) -> str:
        """The displayed type."""
        if self.declared.is_element:
            return local_name(self.element_class) or "any element"
        return _TYPE_NAMES.get(self.declared.wire_type, self.declared.wire_type)

    @property
    def limits(self) -> Limits:
        """The unit and the allowed values."""
        return self.declared.limits

    @property
    def options(self) -> tuple[str, ...]:
        """The texts of the allowed values, if they are enumerated."""
        return tuple(map(str, self.limits.choices))

    @property
    def default_text(self) -> str:
        """The declared default for people; "" without one, and for elements, whose labels the editor knows."""
        default = self.declared.default
        if not default or self.editor is Editor.ELEMENT:
            return ""
        if self.editor is Editor.TRUTH:
            return "yes" if default[0] else "no"
        if self.editor is Editor.JSON or default[0] == "":
            return json.dumps(default if len(default) > 1 else default[0], ensure_ascii=False)
        return str(default[0])

    @property
    def hint(self) -> str:
        """The description, the limits and the default, for people."""
        has_range = (self.limits.minimum, self.limits.maximum) != (None, None)
        default = f"default {self.default_text}" if self.default_text else ""
        return " · ".join(filter(None, (self.declared.description, self.limits.text if has_range else "", default)))

    @property
    def modes(self) -> tuple[ValueMode, ...]:
        """The possible modes; the first is the default."""
        if self.declared.is_element:
            empty = ValueMode.UNSET if self.declared.kind == "optional" else ValueMode.INFER
            return (ValueMode.GIVEN, empty) if self.declared.default else (empty, ValueMode.GIVEN)
        if self.declared.default or self.declared.must_be_given:
            return (ValueMode.GIVEN,)  # for a manager no value means the default
        return (ValueMode.UNSET, ValueMode.GIVEN)

    @property
    def is_default(self) -> bool:
        """Whether it has the default value, which is not sent."""
        if self.mode is not ValueMode.GIVEN or not self.declared.default:
            return self.mode is not ValueMode.GIVEN
        untouched = Field(self.declared)
        return (self.value, self.text) == (untouched.value, untouched.text)

    # -- editing ----------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Restores the declared default."""
        self.mode, self.text, self.value = self.modes[0], "", None
        default = self.declared.default
        first = default[0] if default else None
        if self.editor is Editor.ELEMENT:
            self.value = first["id"] if first is not None else ""
        elif self.editor is Editor.TRUTH:
            self.value = bool(first)
        elif self.editor is Editor.JSON:
            self.text = json.dumps(default if len(default) > 1 else first, ensure_ascii=False) if default else ""
        else:
            self.text = "" if first is None else str(first)
        self._check()

    def write(self, text: str) -> None:
        """Sets the text; an empty text unsets the value where that is possible."""
        self.text = text
        self.mode = ValueMode.UNSET if not text and ValueMode.UNSET in self.modes else ValueMode.GIVEN
        self._check()

    def choose(self, value: Any) -> None:
        """Sets an element by id, or a boolean."""
        self.value, self.mode = value, ValueMode.GIVEN
        self._check()

    def set_mode(self, mode: ValueMode) -> None:
        """Sets the mode; ignored unless it is one of `modes`."""
        if mode in self.modes:
            self.mode = mode
            self._check()

    def _check(self) -> None:
        try:
            self.values()
        except SkirosError as error:
            self.error = str(error)
        else:
            self.error = ""

    def values(self) -> list[Any]:
        """Returns the values to send, as JSON values; none to let the manager infer them or use the default.

        :raises SkirosError: the value is invalid.
        """
        if self.mode is not ValueMode.GIVEN:
            return []
        editor = self.editor
        if editor is Editor.ELEMENT:
            if not self.value:
                raise WrongValue("choose an element")
            return [element_value(str(self.value), self.element_class)]
        if editor is Editor.TRUTH:
            return [bool(self.value)]
        if editor is Editor.CHOICE:
            if self.text not in self.options:
                raise WrongValue(f"expected {self.limits.text}")
            return [self.limits.choices[self.options.index(self.text)]]
        if editor is Editor.TEXT:
            if not self.text and self.declared.must_be_given:
                raise WrongValue("a text is needed")
            return [self.text]
        if not self.text.strip():
            raise WrongValue(f"a {self.type_name} is needed")
        return self._number() if editor is Editor.NUMBER else self._json()

    def _number(self) -> list[Any]:
        text = self.text.strip()
        try:
            (value,) = read_values(self.declared, text, _no_element)
            ok = math.isfinite(value)
        except (SkirosError, ValueError, OverflowError):
            ok = False
        if not ok:
            raise WrongValue(f"{text!r} is not a {self.type_name}")
        if not self.limits.allows(value):
            raise WrongValue(f"expected {self.limits.text}")
        return [value]

    def _json(self) -> list[Any]:
        try:
            read_json(self.text)
        except json.JSONDecodeError as error:
            where = f"line {error.lineno}, column {error.colno}" if "\n" in self.text else f"column {error.colno}"
            raise WrongValue(f"this is not JSON, {where}: {error.msg}") from None
        except ValueError as error:
            raise WrongValue(f"this cannot be read: {error}") from None
        try:
            values = read_values(self.declared, self.text, _no_element)
        except SkirosError:
            example = _EXAMPLES.get(self.declared.wire_type, "")
            such = f", such as {example}" if example else ""
            what = self.type_name if not self._is_several else f"list of values, each a {self.type_name}"
            raise WrongValue(f"a {what} is needed{such}") from None
        problem = self.limits.problem(values)
        if problem:
            raise WrongValue(problem)
        return values

    @property
    def _is_several(self) -> bool:
        return self.editor is Editor.JSON and self.declared.wire_type in _EDITORS


def element_value(eid: str, element_class: str = "") -> dict[str, Any]:
    """Returns an element as a parameter value; the manager reads the rest from the world model."""
    known = {"id": eid, "label": "", "type": element_class or "sumo:Object"}
    return {**known, "last_update": 0.0, "properties": {}, "relations": []}


def _no_element(_: Parameter, name: str) -> Any:
    raise UnknownName(f"{name!r} is not an element")


def element_choices(elements: Iterable[Element]) -> tuple[ElementChoice, ...]:
    """Returns the elements by label and id, those with a label first."""
    found = [ElementChoice(e.id, e.label, e.type) for e in elements if e.id]
    return tuple(sorted(found, key=lambda c: (not c.label, c.label.lower(), len(c.id), c.id)))


#: The display order of parameters.
_ORDER = ("required", "optional", "inferred")


class Form:
    """:param offer: the skill."""

    def __init__(self, offer: Offer) -> None:
        self.offer = offer
        fields = [Field(parameter) for parameter in offer.parameters.values()]
        # The robot comes last, as it is rarely changed.
        fields.sort(key=lambda f: (f.key == ROBOT_KEY, _ORDER.index(f.declared.kind)))
        self.fields: dict[str, Field] = {field.key: field for field in fields}

    @property
    def errors(self) -> dict[str, str]:
        """The invalid fields: error by key."""
        return {field.key: field.error for field in self.fields.values() if field.error}

    @property
    def classes(self) -> list[str]:
        """The classes of the element parameters; "" for any."""
        return sorted({field.element_class for field in self.fields.values() if field.declared.is_element})

    def given(self) -> dict[str, list[Any]]:
        """Returns the valid values that are not defaults, as JSON values by key."""
        return {key: f.values() for key, f in self.fields.items() if not (f.is_default or f.error)}

    def step(self) -> Step:
        """Returns the step to send; requires that there are no `errors`."""
        params = [self.fields[key].declared.wire(values) for key, values in self.given().items()]
        return Step(self.offer.type, self.offer.label, params)

    def reset(self) -> None:
        """Restores all defaults."""
        for field in self.fields.values():
            field.reset()

    def adopt(self, other: Form) -> None:
        """Copies the values of a form for an earlier version of the skill, where the declarations are equal."""
        for key, field in self.fields.items():
            old = other.fields.get(key)
            if old is not None and old.declared == field.declared and not old.is_default:
                field.text, field.value = old.text, old.value
                field.set_mode(old.mode)
