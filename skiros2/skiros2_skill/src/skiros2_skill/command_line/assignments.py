"""Parses the skills to run from a command line: `pick Object=tray Speed=0.5 place Container=box`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.command_line.command import UsageError
from skiros2_common.core.errors import SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.property import as_type, from_text
from skiros2_skill.client.description import NamedSkill, Parameter, Skill, Step, did_you_mean, find_skill

#: Finds the element with an id or label for a parameter. Returns its JSON form.
FindElement = Callable[[Parameter, str], Any]

_SCALARS = {"str": str, "int": int, "float": float, "bool": bool}
_COLLECTIONS = {"list": list, "dict": dict}


def read_steps(
    words: Sequence[str],
    skills: Sequence[Skill],
    find_element: FindElement,
    is_learned: Callable[[str], bool] = lambda skill_type: False,
) -> list[Step]:
    """Parses skills and their parameters, and checks them against the declarations.

    :param is_learned: whether the world model has learned values for a type of skill; then the manager checks.
    :raises SkirosError: a skill or parameters are unknown, values are wrong, or parameters are missing; the text has
        all problems of the first implementation.
    """
    steps: list[tuple[NamedSkill, Step]] = []
    labels = {skill.label for skill in skills}
    for word in words:
        key, sign, value = word.partition("=")
        if not sign or word in labels:
            named = find_skill(word, skills)
            steps.append((named, Step(named.type, named.label)))
        elif not steps:
            raise UsageError(f"{word}: the name of the skill has to come first")
        else:
            steps[-1][1].given.setdefault(key, []).append(value)
    produced: set[str] = set()
    for named, step in steps:
        step.params = _match(named, step.given, produced, find_element, is_learned)
        produced.update(*(skill.parameters for skill in named.skills))
    return [step for _, step in steps]


def _match(
    named: NamedSkill,
    given: dict[str, list[str]],
    produced: set[str],
    find_element: FindElement,
    is_learned: Callable[[str], bool],
) -> list[str]:
    """The parameters for the first implementation that accepts the values."""
    errors = []
    for skill in named.skills:
        try:
            return _params(skill, given, produced, find_element, is_learned)
        except SkirosError as error:
            errors.append(error)
    raise errors[0]


def _params(
    skill: Skill,
    given: dict[str, list[str]],
    produced: set[str],
    find_element: FindElement,
    is_learned: Callable[[str], bool],
) -> list[str]:
    errors: list[UnknownName | WrongValue] = []
    for key in given:
        if key not in skill.parameters:
            hint = did_you_mean(key, skill.parameters)
            errors.append(UnknownName(f"{skill.label} has no parameter {key!r}; {hint}"))
    missing = [p for p in skill.parameters.values() if p.must_be_given and p.key not in {*given, *produced}]
    if missing and not is_learned(skill.type):
        listed = ", ".join(f"{p.key} ({p.type}{': ' if p.description else ''}{p.description})" for p in missing)
        errors.append(WrongValue(f"{skill.label} needs {listed}: give it as {missing[0].key}=VALUE"))
    params = []
    for key, texts in given.items():
        declared = skill.parameters.get(key)
        if declared is None:
            continue
        try:
            params.append(declared.wire([v for text in texts for v in read_values(declared, text, find_element)]))
        except SkirosError as error:
            errors.append(WrongValue(f"{skill.label}, parameter {key}: {error}"))
    if errors:
        raise type(errors[0])("; ".join(map(str, errors)))
    return params


def read_values(declared: Parameter, text: str, find_element: FindElement) -> list[Any]:
    """Parses the values of a parameter; several values are a JSON list.

    A list or dict is one value in JSON. An element is given by id or label, a value of a registered type in
    its JSON form.

    :raises SkirosError: the text has no such values.
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
