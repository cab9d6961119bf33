"""Reads skills, with their parameters and conditions, from elements of the world model.

A skill manager adds an element for each of its skills to its robot (`skiros:hasSkill`), with elements for its
parameters (`skiros:hasParam`) and conditions (`skiros:hasPreCondition` and so on).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from skiros2_common.core.conditions import ConditionBase
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.manager_names import matching_name
from skiros2_common.core.names import full_name
from skiros2_common.core.params import PARAM_TYPE_CODES, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.learned_parameters import HAS_PARAMETER, PARAMETER_SET, SKILL_TYPE

log = logging.getLogger(__name__)

#: The types whose defaults the world model has.
_PLAIN_TYPES = frozenset({str, int, float, bool})

#: The kinds of parameters, by their codes in `skiros:ParameterType`.
_KINDS = {code: kind for kind, code in PARAM_TYPE_CODES.items()}

#: Returns the running managers by node name, with the ids of the robots that they have registered; "": unknown.
#: Is given the names of managers in the scene, which may omit namespace and slash.
RunningManagers = Callable[[Collection[str]], Mapping[str, str]]

MANAGER_PROPERTY = "skiros:SkillMgr"
_MISSING = "skiros:MissingParameter"


@dataclass(frozen=True)
class SkillParameter:
    """A parameter of a skill.

    :param element_class: the class of its element; None if it does not hold an element.
    :param fixed: the id of the element in its declaration; "" if there is none.
    :param missing: it is required, has no default and no learned value, and holds no element that planning can choose.
    :param assumed: it is missing, and planning assumes that it gets a value; see `assume_values`.
    """

    key: str
    kind: ParamTypes
    element_class: str | None
    fixed: str = ""
    missing: bool = False
    assumed: bool = False


@dataclass(frozen=True)
class SkillCondition:
    """A condition of a class in `skiros2_common.core.conditions`.

    :param kind: the name of the class, such as `ConditionRelation`.
    :param name: the relation, property or class that it tests.
    """

    kind: str
    label: str = ""
    subject: str = ""
    object: str = ""
    name: str = ""
    operator: str = "="
    value: str | bool | float | None = None
    state: bool = True
    parts: tuple[SkillCondition, ...] = ()

    @property
    def planned_as(self) -> str:
        """The planning predicate of the condition, see `ConditionBase`; "" if its class is unknown."""
        cls = ConditionBase.classes.get(self.kind)
        return cls.planned_as if cls is not None else ""

    def contradicts(self, other: SkillCondition) -> bool:
        """Whether both test the same fact for different values."""
        return self.state != other.state and replace(self, label="", state=True) == replace(other, label="", state=True)


@dataclass(frozen=True)
class Skill:
    """The declaration of a skill. Equal for all robots that have it.

    :param type: the class, such as `skiros:Pick`.
    :param label: the implementation.
    :param duration: the declared duration (s), if any.
    :param unreadable: why its element cannot be read; "" if it can.
    :param module: the Python module of the implementation; "" if unknown.
    """

    type: str
    label: str
    parameters: tuple[SkillParameter, ...]
    pre: tuple[SkillCondition, ...]
    hold: tuple[SkillCondition, ...]
    post: tuple[SkillCondition, ...]
    available: bool = True
    duration: float | None = None
    unreadable: str = ""
    module: str = field(default="", compare=False)

    @property
    def name(self) -> str:
        return f"{self.type} ({self.label})" if self.label else self.type

    def parameter(self, key: str) -> SkillParameter | None:
        """Returns a parameter by key, or None."""
        return next((p for p in self.parameters if p.key == key), None)


@dataclass(frozen=True)
class Robot:
    """A robot with a skill manager.

    :param id: the robot's element.
    :param manager: the node name of its skill manager, such as `/test_robot`.
    """

    id: str
    manager: str
    skills: tuple[Skill, ...]

    @property
    def libraries(self) -> tuple[str, ...]:
        """The Python packages of the skills, sorted."""
        return tuple(sorted({skill.module.rpartition(".")[0] or skill.module for skill in self.skills} - {""}))


def assume_values(robots: Iterable[Robot]) -> tuple[Robot, ...]:
    """Returns the robots with skills for which no parameter is missing: the missing ones are assumed to get values."""

    def assumed(skill: Skill) -> Skill:
        parameters = (replace(p, missing=False, assumed=True) if p.missing else p for p in skill.parameters)
        return replace(skill, parameters=tuple(parameters))

    return tuple(replace(robot, skills=tuple(map(assumed, robot.skills))) for robot in robots)


def no_managers(named: Collection[str]) -> Mapping[str, str]:
    """Returns no managers: planning cannot know which run."""
    return {}


def read_robots(elements: Mapping[str, Element], running: RunningManagers = no_managers) -> tuple[Robot, ...]:
    """Returns the robots of a scene with the skills of their managers.

    A scene may still have robots of managers that do not run, and several that name the same manager. Only robots that
    a running manager has registered are returned; if no manager runs, all.

    :param elements: all elements of the scene, by id.
    """
    skilled = []
    for element in elements.values():
        written = str(element.value_of(MANAGER_PROPERTY) or "")
        children = _children(element, "skiros:hasSkill", elements) if written else []
        if children:
            skilled.append((element, written, children))
    managers = running([written for _, written, _ in skilled])
    learned = _learned_keys(elements)
    robots = []
    for element, written, children in skilled:
        manager = _manager_of(element.id, written, managers)
        if manager:
            skills = (read_skill(child, elements, learned.get(child.type, frozenset())) for child in children)
            robots.append(Robot(element.id, manager, tuple(skills)))
        else:
            log.info("robot %s is left out: no running manager %s has registered it", element.id, written)
    return tuple(robots)


def _manager_of(robot: str, written: str, managers: Mapping[str, str]) -> str:
    """Returns the node name of a robot's manager; "" if it does not run, or has registered another robot.

    :param written: its name in the scene.
    """
    if not managers:
        return f"/{written.lstrip('/')}"
    named = (name for name in managers if matching_name(written, [name]))
    return next((name for name in named if managers[name] in ("", robot)), "")


def read_skill(element: Element, elements: Mapping[str, Element], learned: Collection[str] = ()) -> Skill:
    """Returns the skill of an element; `unreadable` says why if the element is malformed.

    :param learned: the keys of parameters with learned values.
    """
    try:
        return _read_skill(element, elements, learned)
    except WrongValue as error:
        return Skill(element.type, element.label, (), (), (), (), unreadable=str(error))


def _learned_keys(elements: Mapping[str, Element]) -> dict[str, set[str]]:
    """Returns the keys of parameters with learned values, by skill type."""
    found: dict[str, set[str]] = {}
    for element in elements.values():
        if element.type == PARAMETER_SET:
            keys = found.setdefault(full_name(str(element.value_of(SKILL_TYPE) or "")), set())
            keys.update(child.label for child in _children(element, HAS_PARAMETER, elements))
    return found


def _read_skill(element: Element, elements: Mapping[str, Element], learned: Collection[str]) -> Skill:
    def conditions(relation: str) -> tuple[SkillCondition, ...]:
        return tuple(_condition(child, elements) for child in _children(element, relation, elements))

    missing = element.getProperty(_MISSING).values if element.hasProperty(_MISSING) else []
    parameters = (
        *(_parameter(child) for child in _children(element, "skiros:hasParam", elements)),
        *(SkillParameter(str(key), ParamTypes.Required, None, missing=True) for key in missing),
    )
    parameters = tuple(replace(p, missing=p.missing and p.key not in learned) for p in parameters)
    optional = {f"Has{p.key}": p.key for p in parameters if p.kind is ParamTypes.Optional}

    def is_implicit(condition: SkillCondition) -> bool:
        """Whether the condition is added to every skill with such an optional parameter."""
        return condition.kind == "ConditionGenerate" and optional.get(condition.label) == condition.subject

    return Skill(
        element.type,
        element.label,
        parameters,
        conditions("skiros:hasPreCondition"),
        conditions("skiros:hasHoldCondition"),
        tuple(c for c in conditions("skiros:hasPostCondition") if not is_implicit(c)),
        available=_truth(element.value_of("skiros:AvailableForPlanning"), True),
        duration=_duration(element),
        module=str(element.value_of("skiros:PythonModule") or ""),
    )


def _children(element: Element, relation: str, elements: Mapping[str, Element]) -> list[Element]:
    """Returns the children of an element in the order of their id numbers, which is that of their declaration."""
    ids = {r["dst"] for r in element.getRelations("-1", relation, "") if r["dst"] in elements}
    return sorted((elements[eid] for eid in ids), key=lambda e: (e.getIdNumber(), e.id))


def _parameter(element: Element) -> SkillParameter:
    written = element.value_of("skiros:ParameterType")
    try:
        kind = _KINDS[int(written or 0)]
    except (TypeError, ValueError, KeyError):
        raise WrongValue(f"its parameter {element.label!r} is of type {written!r}, expected 0, 1 or 2") from None
    known_type = element.hasProperty("skiros:DataType")
    datatype = full_name(str(element.value_of("skiros:DataType") or ""))
    if datatype or not known_type or element.hasProperty("skiros:DataType", ""):  # a class; otherwise a Python type
        fixed = element.getRelation("-1", "skiros:hasValue", "")
        return SkillParameter(element.label, kind, datatype or "sumo:Object", fixed["dst"] if fixed else "")
    given = any(element.hasProperty(key, not_none=True) for key in ("skiros:Default", "skiros:Value"))
    python_type = element.getProperty("skiros:DataType").dataType()
    missing = kind is ParamTypes.Required and python_type in _PLAIN_TYPES and not given
    return SkillParameter(element.label, kind, None, missing=missing)


def _condition(element: Element, elements: Mapping[str, Element], parents: tuple[str, ...] = ()) -> SkillCondition:
    if element.id in parents:
        raise WrongValue(f"its condition {element.label!r} ({element.id}) is a part of itself")
    parents = (*parents, element.id)
    parts = tuple(_condition(child, elements, parents) for child in _children(element, "skiros:hasCondition", elements))
    kind = element.type.rpartition(":")[2]
    is_class = kind == "ConditionOnType" and not element.hasProperty("skiros:appliedOnType")
    return SkillCondition(
        kind=kind,
        label=element.label,
        subject=_text(element, "skiros:hasSubject"),
        object=_text(element, "skiros:hasObject"),
        name=_text(element, "skiros:desiredValue" if is_class else "skiros:appliedOnType"),
        operator=_text(element, "skiros:operator") or "=",
        value=None if is_class else _value(element.value_of("skiros:desiredValue")),
        state=_truth(element.value_of("skiros:desiredState"), True),
        parts=parts,
    )


def _text(element: Element, key: str) -> str:
    value = element.value_of(key)
    return "" if value is None else str(value)


def _value(value: Any) -> str | bool | float | None:
    """Returns a value with the texts "True" and "False" as bool, as the conditions themselves do."""
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        return float(value)
    text = str(value)
    return text == "True" if text in ("True", "False") else text


def _duration(element: Element) -> float | None:
    value = element.value_of("skiros:Duration")
    if value is None:
        return None
    try:
        seconds = float(value)
    except (TypeError, ValueError):
        seconds = math.nan
    if math.isfinite(seconds) and seconds >= 0.0:
        return seconds
    log.warning("skill %s-%s: skiros:Duration is %r, expected seconds", element.id, element.label, value)
    return None


def _truth(value: Any, default: bool) -> bool:
    if value is None:
        return default
    return value if isinstance(value, bool) else str(value).strip().lower() in ("true", "1")
