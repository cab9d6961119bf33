"""What would come of a start: which elements the parameters would hold, or why the robot would refuse.

It is found out with the manager's own search and conditions, on the scene as it is known here. Nothing is started.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.discrete_reasoner import reasoners
from skiros2_common.core.errors import SkirosError
from skiros2_common.core.explanation import GIVEN, INFERENCE, PRE, START, Explanation, Provenance
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_gui.skills.catalogue import Offer
from skiros2_gui.skills.fields import ElementChoice, element_choices
from skiros2_skill.command_line.description import KINDS, Parameter, Skill
from skiros2_skill.core.diagnosis.inference_failure import failure_text, filter_candidates
from skiros2_skill.core.engine.failures import PRE_FAILED
from skiros2_skill.core.engine.inference import infer, inferable
from skiros2_skill.core.manager_names import runs_on
from skiros2_task.core.actions import ROBOT_KEY
from skiros2_task.core.preview import make_condition
from skiros2_task.core.skills import SkillCondition, read_skill

_KINDS = dict(zip(KINDS, (ParamTypes.Required, ParamTypes.Optional, ParamTypes.Inferred), strict=True))
_TYPES: dict[str, type] = {"str": str, "int": int, "float": float, "bool": bool, "list": list, "dict": dict}
_SKILL_PARTS = "skiros:skillProperty"


@dataclass(frozen=True)
class StartPreview:
    """What would come of a start.

    :param label: of the implementation that would run; "" when none would.
    :param values: the elements that the robot would find, by key.
    :param refusal: why it would refuse; None when it would start.
    :param unchecked: the conditions that only the robot can check, by label.
    :param choices: the elements of each class that a parameter asks for, by class.
    :param problem: why nothing could be found out, in words; "" when it was.
    """

    label: str = ""
    values: Mapping[str, ElementChoice] = field(default_factory=dict)
    refusal: Explanation | None = None
    unchecked: tuple[str, ...] = ()
    choices: Mapping[str, tuple[ElementChoice, ...]] = field(default_factory=dict)
    problem: str = ""

    @property
    def works(self) -> bool:
        """Whether it would start, as far as that is known."""
        return self.refusal is None and not self.problem


def preview_start(offer: Offer, given: Mapping[str, Sequence[Any]], classes: Sequence[str], wm: Any) -> StartPreview:
    """What would come of a start. Reads the scene; for a worker thread.

    :param given: the values that are given, as JSON has them, by key.
    :param classes: of which the elements to choose from are wanted; "" for any.
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
    """The robot of a manager, and the ids of its skills by type and label; None before it is in the scene."""
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
    """What would come of a start of one implementation."""
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
    """A parameter as the manager would have it."""
    kind = _KINDS[declared.kind]
    if not declared.is_element:
        # What a library has registered is no matter to a condition that can be read here.
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
    """The pre-conditions that a manager has registered for a skill, and the labels of those that only it can check.

    :param skill: the id of the skill's element; "" where there is none.
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
    """Whether the fact can be told here: of a relation that the ontologies do not know, a reasoner has to be there."""
    if read.parts:
        return all(_is_readable(part, wm) for part in read.parts)
    if read.kind != "ConditionRelation":
        return True
    return wm.knows(read.name) or reasoners.find_or_load(read.name) is not None
