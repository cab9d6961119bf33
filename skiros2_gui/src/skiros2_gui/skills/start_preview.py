"""The preview of a start: the elements that parameters would get, or why the robot would refuse.

It uses the manager's inference and conditions on the window's replica of the scene. Nothing is started.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import GIVEN, INFERENCE, PRE, START, Explanation, Provenance
from skiros2_common.core.manager_names import runs_on
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_gui.skills.catalogue import Offer
from skiros2_gui.skills.fields import ElementChoice, element_choices
from skiros2_skill.command_line.description import KINDS, Parameter, Skill
from skiros2_skill.core.diagnosis.inference_failure import failure_text, filter_candidates
from skiros2_skill.core.engine.failures import PRE_FAILED
from skiros2_skill.core.engine.inference import infer, inferable
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.preview import make_condition
from skiros2_task.core.skills import SkillCondition, read_skill

_KINDS = dict(zip(KINDS, (ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred), strict=True))
_TYPES: dict[str, type] = {"str": str, "int": int, "float": float, "bool": bool, "list": list, "dict": dict}
_SKILL_PARTS = "skiros:skillProperty"


@dataclass(frozen=True)
class StartPreview:
    """:param label: of the implementation that would run; "" if none would.
    :param values: the inferred elements, by key.
    :param refusal: why the robot would refuse; None if it would start.
    :param unchecked: the labels of conditions that only the robot can check.
    :param choices: the elements of each class that a parameter requires, by class.
    :param problem: why there is no preview; "" if there is one.
    """

    label: str = ""
    values: Mapping[str, ElementChoice] = field(default_factory=dict)
    refusal: Explanation | None = None
    unchecked: tuple[str, ...] = ()
    choices: Mapping[str, tuple[ElementChoice, ...]] = field(default_factory=dict)
    problem: str = ""

    @property
    def works(self) -> bool:
        """Whether the skill would start, as far as known."""
        return self.refusal is None and not self.problem


def preview_start(offer: Offer, given: Mapping[str, Sequence[Any]], classes: Sequence[str], wm: Any) -> StartPreview:
    """Previews a start. Reads the scene; for a worker thread.

    :param given: the specified values, as JSON values by key.
    :param classes: the classes whose elements are returned as choices; "" for any.
    :param wm: the world model.
    """
    choices = {}
    try:
        choices = {cls: element_choices(wm.resolve_elements(Element(cls))) for cls in dict.fromkeys(classes)}
        robot, registered = _robot(offer.manager, wm)
        refused: list[Explanation] = []
        for skill in offer.implementations:
            preview = _preview(skill, given, robot, registered, wm)
            if preview.refusal is None:
                return StartPreview(skill.label, preview.values, None, preview.unchecked, choices)
            refused.append(preview.refusal)
    except SkirosError as error:
        return StartPreview(choices=choices, problem=str(error))
    if len(refused) == 1:
        return StartPreview(refusal=refused[0], choices=choices)
    text = "; ".join(f"{e.label}: {e.message}" for e in refused)
    refusal = Explanation(START, offer.type, "", -1, PRE_FAILED, text, tried=refused)
    return StartPreview(refusal=refusal, choices=choices)


def _robot(manager: str, wm: Any) -> tuple[Element | None, dict[str, str]]:
    """Returns the robot of a manager, and the ids of its skills by type and label; None if it is not in the scene."""
    robot = next((e for e in wm.resolve_elements(Element("cora:Robot")) if runs_on(e, manager)), None)
    relations = robot.getRelations("-1", "skiros:hasSkill", "") if robot is not None else []
    skills = [wm.find_element(relation["dst"]) for relation in relations]
    return robot, {f"{skill.type}-{skill.label}": skill.id for skill in skills if skill is not None}


def _preview(
    skill: Skill,
    given: Mapping[str, Sequence[Any]],
    robot: Element | None,
    registered: Mapping[str, str],
    wm: Any,
) -> StartPreview:
    """Previews the start of one implementation."""
    params = ParamHandler({key: _param(p, given.get(key, ()), wm) for key, p in skill.parameters.items()})
    if robot is not None and params.hasParam(ROBOT_KEY) and not given.get(ROBOT_KEY):
        params.specify(ROBOT_KEY, robot)
    conditions, unchecked = _pre_conditions(registered.get(skill.name, ""), wm)
    unset = [param.key for param in inferable(params)]
    search = infer(params, conditions, wm) if unset else None
    if search is not None:
        candidates = filter_candidates(search)
        refusal = _refusal(skill, INFERENCE, failure_text(search, candidates), params)
        refusal.candidates = candidates
        return StartPreview(refusal=refusal)
    failed = [c for c in conditions if not c.evaluate(params, wm)]
    if failed:
        findings = [c.explain(params, wm) for c in failed]
        refusal = _refusal(skill, PRE, "; ".join(map(str, findings)), params)
        refusal.findings = findings
        return StartPreview(refusal=refusal)
    found = {key: params[key].value for key in (*unset, ROBOT_KEY) if params.is_bound(key)}
    values = {key: ElementChoice(e.id, e.label, e.type) for key, e in found.items()}
    return StartPreview(skill.label, values, None, tuple(unchecked))


def _refusal(skill: Skill, stage: str, text: str, params: ParamHandler) -> Explanation:
    given = [Provenance(p.key, ", ".join(map(repr, p.values)), GIVEN) for p in params.values() if p.is_bound()]
    return Explanation(stage, skill.type, skill.label, -1, PRE_FAILED, text, params=given)


def _param(declared: Parameter, given: Sequence[Any], wm: Any) -> Param:
    """Returns a parameter as the manager makes it."""
    kind = _KINDS[declared.kind]
    if not declared.is_element:
        # Conditions that can be checked here do not use types registered by libraries.
        datatype = _TYPES.get(declared.wire_type, object)
        param = Param(declared.key, declared.description, datatype, kind)
        values = list(given or declared.default)
        if datatype is not object and values:
            param.assign(values)
        return param
    declared_class = "" if declared.type == "element" else declared.type
    param = Param(declared.key, declared.description, Element(declared_class or "sumo:Object"), kind)
    ids = [value["id"] for value in given or declared.default]
    if ids:
        param.assign([wm.get_element(eid) for eid in ids])
    return param


def _pre_conditions(skill: str, wm: Any) -> tuple[list[Any], list[str]]:
    """Returns the pre-conditions registered for a skill, and the labels of those that only the manager can check.

    :param skill: the id of the skill's element; "" for none.
    """
    conditions: list[Any] = []
    unchecked: list[str] = []
    elements = {e.id: e for e in wm.get_branch(skill, _SKILL_PARTS)} if skill else {}
    for read in read_skill(elements[skill], elements).pre if elements else ():
        condition = make_condition(read) if _is_readable(read, wm) else None
        if condition is None:
            unchecked.append(read.label or read.kind)
        else:
            conditions.append(condition)
    return conditions, unchecked


def _is_readable(read: SkillCondition, wm: Any) -> bool:
    """Returns whether a condition can be checked here: a relation has to be in the ontologies or have a reasoner."""
    if read.parts:
        return all(_is_readable(part, wm) for part in read.parts)
    if read.kind != "ConditionRelation":
        return True
    return wm.knows(read.name) or reasoners.find_or_load(read.name) is not None
