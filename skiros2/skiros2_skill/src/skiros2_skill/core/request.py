"""From a request to run some skills to a task: checked whole before anything starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import Refused, SkirosError, UnknownName, WrongType, WrongValue
from skiros2_common.core.explanation import GIVEN, PARAMETER, START, Explanation, Origin
from skiros2_common.core.names import full_name
from skiros2_common.core.params import Param, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library import Implementation, SkillLibrary
from skiros2_skill.core.origins import told_values
from skiros2_skill.core.wrapper import SkillWrapper


@dataclass(frozen=True)
class SkillRequest:
    """A skill to run: its type, the label of an implementation ("" for any), and parameters by key."""

    type: str
    label: str
    params: Mapping[str, Param]


def make_nodes(requests: Sequence[SkillRequest], library: SkillLibrary, wmi: Any) -> list[SkillWrapper]:
    """The nodes of a task that runs these skills one after the other.

    :raises Refused: there is no skill, or a required parameter is not set.
    :raises UnknownName: a skill, a parameter or an element does not exist.
    :raises WrongType: a value is of another type than declared.
    """
    if not requests:
        raise Refused("a task needs at least one skill, the list is empty")
    nodes: list[SkillWrapper] = []
    produced: set[str] = set()
    for request in requests:
        given, problems = _fitting(request, library, wmi, produced)
        if given is None:
            if len(problems) == 1:
                raise problems[0][1]
            raise WrongValue("; ".join(str(error) for _, error in problems))
        node = SkillWrapper(request.type, request.label, library)
        for key, values in given.items():
            node.specifyParam(key, values)
        nodes.append(node)
    return nodes


def why_refused(requests: Sequence[SkillRequest], library: SkillLibrary, wmi: Any, code: int) -> Explanation | None:
    """Why `make_nodes` refuses some requests: of the first wrong one, what is wrong for each implementation.

    :param code: for the explanation.
    :returns: None when none is wrong by itself.
    """
    produced: set[str] = set()
    for request in requests:
        params = [Origin(key, told_values(p.values), GIVEN) for key, p in request.params.items() if p.values]
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
    """The values that the request gives, checked against what the implementation declares."""
    declared = implementation.declared.params
    name = f"{implementation.type}-{implementation.label}"
    given: dict[str, list[Any]] = {}
    for key, param in request.params.items():
        if not declared.hasParam(key):
            raise UnknownName(f"{name} has no parameter {key!r}; it has: {', '.join(declared.keys())}")
        values = [v for v in param.values if not _says_nothing(v)]
        if not values:
            continue
        try:
            declared.getParamMap()[key].clone().assign(values)
        except WrongType as error:
            raise WrongType(f"{name}, parameter {error}") from None
        for value in values:
            if isinstance(value, Element) and not value.isAbstract() and wmi.find_element(value.id) is None:
                raise UnknownName(f"{name}, parameter {key!r}: there is no element {value.id!r} in the scene")
        given[key] = values
    for key, param in declared.items():
        needed = param.paramTypeIs(ParamTypes.Required) and not param.is_element and not param.isSpecified()
        if needed and key not in given and key not in produced:
            raise Refused(f"{name}: required parameter {key!r} ({param.dataType().__name__}) is not set")
    return given


def _says_nothing(value: Any) -> bool:
    """Whether a value is an abstract element without a label, property or relation: "any of the type"."""
    return (
        isinstance(value, Element)
        and value.isAbstract()
        and not (value.label or value.available_properties or value.getRelations())
    )
