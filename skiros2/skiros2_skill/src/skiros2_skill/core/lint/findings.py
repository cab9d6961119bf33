"""Findings of skills, and the checks of a skill's description."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.names import ANY_TYPE, full_name
from skiros2_common.core.params import Param
from skiros2_common.core.skill_description import DEVICE_STATE
from skiros2_common.core.source_location import SourceLocation
from skiros2_common.core.world_model_port import WorldModelPort
from skiros2_skill.core.library.description import Described, class_location

ERROR, WARNING, NOTE = "error", "warning", "note"

UNKNOWN_SKILL, NOT_DESCRIBED = "unknown-skill", "not-described"


@dataclass(frozen=True)
class Finding:
    """A finding of a skill.

    :param severity: `ERROR`, `WARNING` or `NOTE`.
    :param code: the kind of finding.
    :param skill: `type-label`.
    :param file, line: the source location; "" and 0 when it is not known.
    :param consequence: when the skill is loaded and run.
    """

    severity: str
    code: str
    skill: str
    text: str
    file: str = ""
    line: int = 0
    consequence: str = ""

    def __str__(self) -> str:
        consequence = f" ({self.consequence})" if self.consequence else ""
        return f"{self.file}:{self.line}: {self.severity}: [{self.code}] {self.skill}: {self.text}{consequence}"

    def to_dict(self) -> dict[str, Any]:
        data = asdict(self)
        data["done"] = data.pop("consequence")
        return data


def finding_of(
    described: Described,
    severity: str,
    code: str,
    text: str,
    place: SourceLocation | None = None,
    consequence: str = "",
) -> Finding:
    """Creates a finding of a skill.

    :param place: its source location; None: that of the class.
    """
    file, line = place or class_location(described.cls)
    return Finding(severity, code, described.name, text, file, line, consequence)


_IMPLEMENTATION_WINS = "loaded; the declaration of the implementation is used"
_KEPT = "loaded; the name is kept as written"


def description_findings(described: Described, wmi: WorldModelPort | None) -> Iterator[Finding]:
    """The findings of a skill's parameters and conditions."""
    yield from _condition_findings(described)
    yield from _limit_findings(described)
    yield from _contradictions(described)
    yield from _description_contradictions(described, wmi)
    if wmi is not None:
        yield from _unknown_names(described, wmi)


def parts(conditions: Sequence[ConditionBase]) -> Iterator[tuple[ConditionBase, SourceLocation | None]]:
    """The conditions and the parts of composite ones, with their source locations."""
    for condition in conditions:
        yield condition, condition.source_location
        yield from ((part, condition.source_location) for part, _ in parts(condition.parts))


def fits(inner: Param, outer: Param, wmi: WorldModelPort | None) -> bool:
    """Whether a value of one parameter may be a value of the other."""
    if inner.is_element and outer.is_element:
        return related(inner.element_type, outer.element_type, wmi)
    number = {inner.dataType(), outer.dataType()} == {int, float}
    return number or inner.dataType() is outer.dataType()


def related(one: str, other: str, wmi: WorldModelPort | None) -> bool:
    """Whether one class is the same as, a subclass or a superclass of the other; True when that is not known."""
    one, other = full_name(one) if one else "", full_name(other) if other else ""
    if wmi is None or not one or not other or one == other:
        return True
    if not (wmi.knows(one) and wmi.knows(other)):
        return True
    return bool(wmi.is_subclass(one, other) or wmi.is_subclass(other, one))


def type_name(param: Param) -> str:
    """The type of a parameter, for people."""
    return (param.element_type or "an element") if param.is_element else param.dataType().__name__


def _stages(described: Described) -> dict[str, list[ConditionBase]]:
    skill = described.skill
    return {"pre": skill.pre_conditions, "hold": skill.hold_conditions, "post": skill.post_conditions}


def _condition_findings(described: Described) -> Iterator[Finding]:
    params = described.skill.params.getParamMap()
    known = ", ".join(params)
    for stage, conditions in _stages(described).items():
        for condition, place in parts(conditions):
            if condition.parts:
                continue
            name = f"{stage}-condition [{condition.label}]"
            for text in condition.faults(stage):
                yield finding_of(described, WARNING, "wrong-stage", f"{name} {text}", place, "loaded; a start fails")
            for key in condition.getKeys():
                param = params.get(key)
                if param is None:
                    if not described.is_open:
                        text = f"{name} refers to {key!r}; the parameters are: {known}"
                        consequence = "loaded; it fails where the condition is checked and no such parameter was added"
                        yield finding_of(described, WARNING, "unknown-key", text, place, consequence)
                elif key in condition.element_keys and not param.is_element:
                    text = f"{name} wants an element, parameter {key!r} is of type {type_name(param)}"
                    yield finding_of(
                        described, WARNING, "wrong-type", text, place, "loaded; the condition does not hold"
                    )


def _limit_findings(described: Described) -> Iterator[Finding]:
    """Mistakes in the limits of parameters, and defaults outside them."""
    for key, param in described.skill.params.items():
        defaults = [] if param.is_element else param.defaults
        for problem in param.limits.faults(param.dataType(), defaults):
            text, place = f"parameter {key!r} {problem}", described.skill.location_of(key)
            yield finding_of(
                described, WARNING, "limits", text, place, "loaded; a start with a value outside is refused"
            )


def _contradictions(described: Described) -> Iterator[Finding]:
    stages = _stages(described)
    for stage, conditions in stages.items():
        for one, other in combinations(conditions, 2):
            if one.hasConflict(other):
                text = f"{stage}-conditions [{one.label}] and [{other.label}] cannot both hold"
                place = other.source_location
                yield finding_of(described, WARNING, "contradiction", text, place, "loaded; a start fails")
    for pre in stages["pre"]:
        for hold in stages["hold"]:
            if ("property", DEVICE_STATE) not in pre.ontology_names() and pre.hasConflict(hold):
                text = f"[{pre.label}] has to hold at the start, and not to hold while the skill runs ([{hold.label}])"
                place = hold.source_location
                yield finding_of(described, WARNING, "contradiction", text, place, "loaded; both are checked")


def _description_contradictions(described: Described, wmi: WorldModelPort | None) -> Iterator[Finding]:
    """Findings of an implementation that contradicts its description, by which it is selected."""
    skill = described.skill
    base = skill.skill_description
    for key, wanted in base.params.items():
        own = skill.params.getParamMap().get(key)
        place = skill.location_of(key)
        if own is None:
            text = f"the description {base.type} has the parameter {key!r}, the implementation has not"
            yield finding_of(described, WARNING, "contradicts-description", text, consequence=_IMPLEMENTATION_WINS)
        elif not _narrows(own, wanted, wmi):
            text = f"parameter {key!r} is {type_name(wanted)} in the description {base.type}, here {type_name(own)}"
            yield finding_of(described, WARNING, "contradicts-description", text, place, _IMPLEMENTATION_WINS)


def _narrows(own: Param, wanted: Param, wmi: WorldModelPort | None) -> bool:
    """Whether each value of the implementation's parameter is one of the description's."""
    if not (own.is_element and wanted.is_element):
        return own.is_element == wanted.is_element and own.dataType() is wanted.dataType()
    mine, theirs = own.element_type, wanted.element_type
    if wmi is None or not mine or not theirs or mine == theirs or not (wmi.knows(mine) and wmi.knows(theirs)):
        return True
    return bool(wmi.is_subclass(mine, theirs))


def _unknown_names(described: Described, wmi: WorldModelPort) -> Iterator[Finding]:
    skill = described.skill
    for key, param in skill.params.items():
        if param.is_element and param.element_type not in ANY_TYPE and not wmi.knows(param.element_type):
            text = f"parameter {key!r} is a {param.element_type}, which no ontology declares"
            yield finding_of(described, WARNING, "unknown-class", text, skill.location_of(key), _KEPT)
    for stage, conditions in _stages(described).items():
        for condition, place in parts(conditions):
            for kind, name in condition.ontology_names():
                if not wmi.knows(name) and reasoners.find_or_load(name) is None:
                    text = f"{stage}-condition [{condition.label}] refers to {name}, which no ontology declares"
                    yield finding_of(described, WARNING, f"unknown-{kind}", text, place, _KEPT)
