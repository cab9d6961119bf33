"""What is to be run, from the words of a command line: `pick Object=tray Speed=0.5 place Container=box`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.command_line.command import UsageError
from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.json_text import read_json
from skiros2_common.core.property import as_type, from_text
from skiros2_skill.command_line.description import Choice, Parameter, Skill, choose, did_you_mean

#: Finds the element that a text names for a parameter, as JSON has it.
FindElement = Callable[[Parameter, str], Any]

_SCALARS = {"str": str, "int": int, "float": float, "bool": bool}
_COLLECTIONS = {"list": list, "dict": dict}


@dataclass
class Step:
    """A skill to run.

    :param given: the texts by key, in their order.
    :param params: the parameters with their values, as messages have them.
    """

    type: str
    label: str
    given: dict[str, list[str]] = field(default_factory=dict)
    params: list[str] = field(default_factory=list)


def read_steps(words: Sequence[str], skills: Sequence[Skill], find_element: FindElement) -> list[Step]:
    """The skills to run with their parameters, checked against what they declare.

    :raises SkirosError: a skill or parameter is not known, a value does not fit, or a parameter is missing.
    """
    steps: list[tuple[Choice, Step]] = []
    labels = {skill.label for skill in skills}
    for word in words:
        key, sign, value = word.partition("=")
        if not sign or word in labels:
            choice = choose(word, skills)
            steps.append((choice, Step(choice.type, choice.label)))
        elif not steps:
            raise UsageError(f"{word}: the name of the skill has to come first")
        else:
            steps[-1][1].given.setdefault(key, []).append(value)
    produced: set[str] = set()
    for choice, step in steps:
        step.params = _fitting(choice, step.given, produced, find_element)
        produced.update(*(skill.parameters for skill in choice.skills))
    return [step for _, step in steps]


def _fitting(choice: Choice, given: dict[str, list[str]], produced: set[str], find_element: FindElement) -> list[str]:
    """The parameters as the first implementation takes them that these values fit."""
    errors = []
    for skill in choice.skills:
        try:
            return _params(skill, given, produced, find_element)
        except SkirosError as error:
            errors.append(error)
    raise errors[0]


def _params(skill: Skill, given: dict[str, list[str]], produced: set[str], find_element: FindElement) -> list[str]:
    unknown = [key for key in given if key not in skill.parameters]
    if unknown:
        hint = did_you_mean(unknown[0], skill.parameters)
        raise UnknownName(f"{skill.label} has no parameter {unknown[0]!r}; {hint}")
    missing = [p for p in skill.parameters.values() if p.has_to_be_given and p.key not in {*given, *produced}]
    if missing:
        told = ", ".join(f"{p.key} ({p.type}{': ' if p.description else ''}{p.description})" for p in missing)
        raise WrongValue(f"{skill.label} needs {told}: give it as {missing[0].key}=VALUE")
    params = []
    for key, texts in given.items():
        declared = skill.parameters[key]
        try:
            params.append(declared.wire([v for text in texts for v in read_values(declared, text, find_element)]))
        except SkirosError as error:
            raise WrongValue(f"{skill.label}, parameter {key}: {error}") from None
    return params


def read_values(declared: Parameter, text: str, find_element: FindElement) -> list[Any]:
    """The values that a text writes for a parameter: several as a JSON list.

    A list or dict is one value and written in JSON, an element by its id or label; what is of a type that a library
    has registered is given in that type's JSON form.

    :raises SkirosError: the text writes no such values.
    """
    kind = declared.wire_type
    try:
        data = read_json(text)
    except ValueError:
        data = None
    if kind in _COLLECTIONS:
        if not isinstance(data, _COLLECTIONS[kind]):
            raise WrongValue(f"expected a {kind} in JSON, got {text!r}")
        return [data]
    if declared.is_element:
        names = data if _is_list_of(data, str) else [text]
        return [find_element(declared, name) for name in names]
    if kind not in _SCALARS:
        if data is None:
            raise WrongValue(f"expected the JSON form of {kind}, got {text!r}")
        return data if isinstance(data, list) else [data]
    scalar = _SCALARS[kind]
    if not isinstance(data, list) or (scalar is str and not _is_list_of(data, str)):
        return [from_text(text, scalar)]
    try:
        return [as_type(value, scalar) for value in data]
    except WrongType as error:
        raise WrongValue(str(error)) from None


def _is_list_of(data: Any, kind: type) -> bool:
    return isinstance(data, list) and all(isinstance(value, kind) for value in data)
