"""From a request to run some skills to a task: checked whole before anything starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import Refused, SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.explanation import GIVEN, PARAMETER, START, Explanation, Provenance
from skiros2_common.core.names import full_name, nearest
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library import Implementation, SkillLibrary
from skiros2_skill.core.origins import told_values
from skiros2_skill.core.wrapper import SkillWrapper


@dataclass(frozen=True)
class Plain:
    """Values as JSON has them; the skill declares their type. Elements are named by id or label."""

    values: Sequence[Any]


@dataclass(frozen=True)
class SkillRequest:
    """A skill to run: its type, the label of an implementation ("" for any), and parameters by key.

    :param problems: what was wrong with parameters that could not be read.
    """

    type: str
    label: str
    params: Mapping[str, Param | Plain]
    problems: Sequence[SkirosError] = ()


def make_nodes(requests: Sequence[SkillRequest], library: SkillLibrary, wmi: Any) -> list[SkillWrapper]:
    """The nodes of a task that runs these skills one after the other.

    :raises Refused: there is no skill, or a required parameter is not set.
    :raises UnknownName: a skill, a parameter or an element does not exist.
    :raises WrongType: a value is of another type than declared.
    :raises WrongValue: there are several problems, also of several skills; the text names all.
    """
    if not requests:
        raise Refused("a task needs at least one skill, the list is empty")
    nodes: list[SkillWrapper] = []
    produced: set[str] = set()
    all_problems: list[SkirosError] = []
    for request in requests:
        try:
            given, problems = _fitting(request, library, wmi, produced)
        except SkirosError as error:
            all_problems += [*request.problems, error]
            continue
        if given is None:
            all_problems += [error for _, error in problems]
            produced.update(key for implementation, _ in problems for key in implementation.declared.params)
            continue
        node = SkillWrapper(request.type, request.label, library)
        for key, values in given.items():
            node.specifyParamDefault(key, values)
        nodes.append(node)
    if all_problems:
        raise _as_one(all_problems)
    return nodes


def _as_one(problems: Sequence[SkirosError]) -> SkirosError:
    return problems[0] if len(problems) == 1 else WrongValue("; ".join(dict.fromkeys(map(str, problems))))


def why_refused(requests: Sequence[SkillRequest], library: SkillLibrary, wmi: Any, code: int) -> Explanation | None:
    """Why `make_nodes` refuses some requests: of the first wrong one, what is wrong for each implementation.

    :param code: for the explanation.
    :returns: None when none is wrong by itself.
    """
    produced: set[str] = set()
    for request in requests:
        params = [Provenance(key, told_values(p.values), GIVEN) for key, p in request.params.items() if p.values]
        stype = full_name(request.type)
        try:
            given, problems = _fitting(request, library, wmi, produced)
        except SkirosError as error:
            return Explanation(START, stype, request.label, -1, code, str(error), params=params)
        if given is None:
            tried = [
                Explanation(PARAMETER, stype, i.label, -1, code, str(error), params=params) for i, error in problems
            ]
            text = "; ".join(t.message for t in tried)
            return tried[0] if len(tried) == 1 else Explanation(START, stype, "", -1, code, text, tried=tried)
    return None


def _fitting(
    request: SkillRequest, library: SkillLibrary, wmi: Any, produced: set[str]
) -> tuple[dict[str, list[Any]] | None, list[tuple[Implementation, SkirosError]]]:
    """The values that a request gives, checked against what the first implementation that they fit declares.

    :param produced: the keys of the skills before; those of this one are added.
    :returns: None for the values where they fit none; what is wrong for each that they do not fit.
    :raises UnknownName: there is no such skill.
    """
    problems: list[tuple[Implementation, SkirosError]] = []
    for implementation in library.candidates(request.type, request.label):
        try:
            given = _checked(request, implementation, wmi, produced)
        except SkirosError as error:
            problems.append((implementation, error))
            continue
        produced.update(implementation.declared.params.keys())
        return given, problems
    return None, problems


def _checked(
    request: SkillRequest, implementation: Implementation, wmi: Any, produced: set[str]
) -> dict[str, list[Any]]:
    """The values that the request gives, checked against what the implementation declares.

    :raises SkirosError: something is wrong; the text names all of it.
    """
    declared = implementation.declared.params
    name = f"{implementation.type}-{implementation.label}"
    given: dict[str, list[Any]] = {}
    problems = [*request.problems]
    wrong: set[str] = set()
    for key, param in request.params.items():
        if not declared.hasParam(key):
            problems.append(UnknownName(f"{name} has no parameter {key!r}; it has: {', '.join(declared.keys())}"))
            continue
        try:
            values = _checked_values(declared.getParamMap()[key], param, wmi)
        except WrongType as error:
            wrong.add(key)
            problems.append(WrongType(f"{name}, parameter {error}"))
        except SkirosError as error:
            wrong.add(key)
            problems.append(type(error)(f"{name}, parameter {key!r}: {error}"))
        else:
            if values:
                given[key] = values
    for key, param in declared.items():
        needed = param.paramTypeIs(ParamTypes.Required) and not param.is_element and not param.is_bound()
        if needed and key not in given and key not in produced and key not in wrong:
            problems.append(Refused(f"{name}: required parameter {key!r} ({param.dataType().__name__}) is not set"))
    if problems:
        raise _as_one(problems)
    return given


def _checked_values(declared: Param, given: Param | Plain, wmi: Any) -> list[Any]:
    """The values that a request gives for a parameter; none where they say nothing.

    :raises WrongType: a value is of another type than declared; the text begins with the key.
    :raises UnknownName: there is no such element.
    :raises WrongValue: several elements have that label.
    """
    values = list(given.values)
    if isinstance(given, Plain) and declared.is_element:
        values = [_named_element(value, declared.key, wmi) for value in values]
    values = [v for v in values if not _says_nothing(v)]
    if values:
        declared.clone().assign(values)
    for value in values:
        if isinstance(value, Element) and not value.isAbstract() and wmi.find_element(value.id) is None:
            raise UnknownName(f"there is no element {value.id!r} in the scene")
    return values


def _named_element(value: Any, key: str, wmi: Any) -> Element:
    """The element that a JSON value names: its id, its label, or an object with some of id, label and type."""
    if isinstance(value, Mapping):
        parts = [value.get(part, "") for part in ("type", "label", "id")]
        if not all(isinstance(part, str) for part in parts):
            raise WrongType(f"{key}: expected texts as id, label and type of an element, got {value!r}")
        if not parts[2]:
            return Element(*parts)
        value = parts[2]
    if not isinstance(value, str):
        raise WrongType(f"{key}: expected the id or label of an element, got {value!r}")
    element: Element | None = wmi.find_element(value)
    if element is not None:
        return element
    found: list[Element] = wmi.resolve_elements(Element("", value))
    if len(found) > 1:
        raise WrongValue(f"several elements are labelled {value!r}: {', '.join(sorted(e.id for e in found))}")
    if not found:
        labels = {name for e in wmi.get_scene()[0] for name in (e.id, e.label) if name}
        near = nearest(value, sorted(labels))
        hint = f"; near: {', '.join(near)}" if near else ""
        raise UnknownName(f"no element has the id or label {value!r}{hint}")
    return found[0]


def _says_nothing(value: Any) -> bool:
    """Whether a value is an abstract element without a label, property or relation: "any of the type"."""
    return (
        isinstance(value, Element)
        and value.isAbstract()
        and not (value.label or value.available_properties or value.getRelations())
    )
