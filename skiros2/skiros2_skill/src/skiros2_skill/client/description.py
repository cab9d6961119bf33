"""The skills of a manager, and requests to run them, as plain data, independent of types that libraries register."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import UnknownName
from skiros2_common.core.explanation import Explanation
from skiros2_common.core.limits import NO_LIMITS, Limits
from skiros2_common.core.names import full_name, local_name, nearest

#: By the `specType` on the wire.
KINDS = ("required", "optional", "inferred")
REQUIRED = KINDS[0]

#: How many names are listed when none is near.
_MAX_NAMES = 12

_ELEMENT = "skiros_wm::Element"


@dataclass(frozen=True)
class Parameter:
    """A parameter that a skill declares.

    :param kind: one of `KINDS`.
    :param wire_type: the name of the type in messages.
    :param values: the default in JSON form; for an element parameter, an abstract element of its class.
    :param limits: the unit and the allowed values.
    """

    key: str
    kind: str
    wire_type: str
    values: list[Any]
    description: str = ""
    limits: Limits = NO_LIMITS

    @property
    def is_element(self) -> bool:
        return self.wire_type == _ELEMENT

    @property
    def type(self) -> str:
        """The name of the type; for an element, its class."""
        if not self.is_element:
            return self.wire_type
        return next((v["type"] for v in self.values if v.get("type")), "element")

    @property
    def default(self) -> list[Any]:
        """The default values; an abstract element does not count."""
        return [v for v in self.values if not self.is_element or v.get("id")]

    @property
    def must_be_given(self) -> bool:
        return self.kind == REQUIRED and not self.is_element and not self.default

    def wire(self, values: Sequence[Any]) -> str:
        """Encodes the parameter with values for a message."""
        data = {"key": self.key, "description": self.description, "specType": KINDS.index(self.kind)}
        return json.dumps({**data, "type": self.wire_type, "values": list(values)})

    def as_json(self) -> dict[str, Any]:
        default = [v["id"] for v in self.default] if self.is_element else self.default
        return {
            "key": self.key,
            "kind": self.kind,
            "type": self.type,
            "default": default,
            "description": self.description,
            **self.limits.to_json(),
        }


@dataclass(frozen=True)
class Skill:
    """An implementation that a manager offers.

    :param label: names the implementation.
    """

    type: str
    label: str
    parameters: dict[str, Parameter] = field(default_factory=dict)

    @property
    def name(self) -> str:
        return f"{self.type}-{self.label}"


def read_skill(skill_type: str, label: str, params: Iterable[str]) -> Skill:
    """Decodes a skill from a message.

    :param params: the parameters as JSON texts.
    """
    read = [_read_parameter(json.loads(text)) for text in params]
    return Skill(skill_type, label, {p.key: p for p in read})


def _read_parameter(data: dict[str, Any]) -> Parameter:
    kind, description = KINDS[data["specType"]], data.get("description", "")
    return Parameter(data["key"], kind, data["type"], data["values"], description, Limits.from_json(data))


@dataclass
class Step:
    """A skill to run with values for its parameters.

    :param label: of the implementation; "" for any.
    :param params: the parameters with their values, as JSON texts of messages.
    :param given: from a command line: the value texts by key, in order.
    """

    type: str
    label: str
    params: list[str] = field(default_factory=list)
    given: dict[str, list[str]] = field(default_factory=dict)


@dataclass(frozen=True)
class NamedSkill:
    """A name that was looked up: a type with all its implementations, or one implementation.

    :param label: "" for any implementation.
    """

    type: str
    label: str
    skills: list[Skill]


def find_skill(name: str, skills: Sequence[Skill]) -> NamedSkill:
    """Finds a skill by label, type or `type-label`; the prefix of the default ontology may be omitted.

    :raises UnknownName: there is none.
    """
    for skill in skills:
        if name in (skill.label, skill.name, skill.name.removeprefix("skiros:")):
            return NamedSkill(skill.type, skill.label, [skill])
    of_type = [skill for skill in skills if skill.type == full_name(name)]
    if of_type:
        return NamedSkill(of_type[0].type, "", of_type)
    names = [word for skill in skills for word in (skill.label, local_name(skill.type), skill.type)]
    raise UnknownName(f"there is no skill {name!r}; {did_you_mean(name, names)}")


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """A hint with the nearest name, ignoring case; with the first names when none is near."""
    known = list(dict.fromkeys(names))
    near = nearest(name, known, 1)
    if near:
        return f"did you mean {near[0]!r}?"
    more = f" and {len(known) - _MAX_NAMES} more" if len(known) > _MAX_NAMES else ""
    return f"there are: {', '.join(known[:_MAX_NAMES]) or 'none'}{more}"


@dataclass(frozen=True)
class Why:
    """Why a task or its nodes failed.

    :param text: for people, on several lines.
    :param explanations: one per failure, the last one at the end.
    """

    text: str
    explanations: list[Explanation]

    def to_dict(self) -> dict[str, Any]:
        """Returns {text, explanations} as JSON data."""
        return {"text": self.text, "explanations": [each.to_dict() for each in self.explanations]}
