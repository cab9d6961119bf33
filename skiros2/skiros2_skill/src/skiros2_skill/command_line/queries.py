"""The commands list, describe and why, and the data about skills in the world model."""

from __future__ import annotations

import argparse
import json
import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skiros2_common.command_line.command import CommandResult
from skiros2_common.command_line.layout import Screen, table
from skiros2_common.core.errors import SkirosError, UnknownName, WrongValue
from skiros2_common.core.manager_names import runs_on
from skiros2_common.core.names import id_number, local_name
from skiros2_common.core.world_element import Element
from skiros2_skill.client.description import REQUIRED, Parameter, Skill, did_you_mean, find_skill
from skiros2_skill.client.port import ManagerPort
from skiros2_skill.core.engine.learned_parameters import has_learned_values
from skiros2_world_model.command_line.program import connect
from skiros2_world_model.core.world_model_client import WorldModelClient

log = logging.getLogger(__name__)

#: The relations from a skill to its conditions, by stage.
CONDITIONS = {
    "pre": "skiros:hasPreCondition",
    "hold": "skiros:hasHoldCondition",
    "post": "skiros:hasPostCondition",
}
_PARTS = "skiros:hasCondition"


@dataclass(frozen=True)
class Condition:
    """A declared condition.

    :param text: for people, with parameter keys.
    """

    label: str
    text: str


@dataclass(frozen=True)
class Registered:
    """The registration of a skill.

    :param purpose: the first paragraph of its description's docstring; may be "".
    :param module: the Python module that implements it; may be "".
    :param conditions: by the keys of `CONDITIONS`.
    :param classes: its superclasses below `skiros:Skill`, and its own class last.
    """

    purpose: str = ""
    module: str = ""
    conditions: dict[str, list[Condition]] = field(default_factory=dict)
    classes: list[str] = field(default_factory=list)


class World:
    """The world model of a manager; connects on first use.

    :param manager: the manager's node name; the world model is `wm` in its namespace.
    :param author: named in the log.
    :param wm: a connection to it; None: a new one.
    """

    def __init__(self, manager: str, author: str, wm: WorldModelClient | None = None) -> None:
        self._manager = manager
        self._author = author
        self._wm = wm

    @classmethod
    def of(cls, manager: ManagerPort) -> World:
        """The world model of a manager."""
        return cls(manager.name, manager.author, manager.world_model)

    @property
    def _client(self) -> WorldModelClient:
        if self._wm is None:
            self._wm = connect(f"{self._manager.rpartition('/')[0]}/wm", self._author)
        return self._wm

    def find_element(self, declared: Parameter, name: str) -> Any:
        """Finds an element by id, or by label and the parameter's class. Returns its JSON form.

        :raises UnknownName: there is none.
        :raises WrongValue: several elements have that label.
        :raises Unavailable: the world model does not answer.
        """
        found = self._client.find_element(name) if name else None
        matching = [found] if found is not None else self._client.resolve_elements(Element(declared.type, name))
        if len(matching) == 1 and name:
            return _reference(matching[0])
        if matching and name:
            ids = ", ".join(element.id for element in matching)
            raise WrongValue(f"{len(matching)} elements are labelled {name!r}, {ids}: give the id")
        known = self.elements_for(declared)
        names = [word for element in known for word in (element.label, element.id) if word]
        raise UnknownName(f"there is no {declared.type} with the id or label {name!r}; {did_you_mean(name, names)}")

    def elements_for(self, declared: Parameter) -> list[Element]:
        """The elements of a parameter's class.

        :raises Unavailable: the world model does not answer.
        """
        return self._client.resolve_elements(Element(declared.type))

    def has_learned_values(self, skill_type: str) -> bool:
        """Whether the world model has a parameter set for a type of skill. False if it does not answer."""
        try:
            return has_learned_values(skill_type, self._client)
        except SkirosError as error:
            log.debug("learned values of %s: %s", skill_type, error)
            return False

    def registered(self, skill_type: str, label: str) -> Registered:
        """The registration of a skill of the manager.

        :raises UnknownName: the manager has registered no such skill.
        :raises Unavailable: the world model does not answer.
        """
        for eid in self._skill_ids():
            if eid.rpartition("-")[0] == skill_type:
                branch = {element.id: element for element in self._client.get_branch(eid, "skiros:skillProperty")}
                skill = branch[eid]
                if skill.label == label:
                    purpose, module = (skill.value_of(key) or "" for key in ("rdfs:comment", "skiros:PythonModule"))
                    return Registered(purpose, module, _conditions(skill, branch), self._classes(skill_type))
        raise UnknownName(f"{self._manager} has registered no skill {skill_type}-{label}")

    def _skill_ids(self) -> list[str]:
        robots = [r for r in self._client.resolve_elements(Element("cora:Robot")) if runs_on(r, self._manager)]
        relations = (r.getRelations("-1", "skiros:hasSkill") for r in robots)
        return [relation["dst"] for some in relations for relation in some]

    def _classes(self, skill_type: str) -> list[str]:
        """The classes between `skiros:Skill` and a type, and the type last."""
        query = f"SELECT ?c ?p {{ {skill_type} rdfs:subClassOf* ?c . ?c rdfs:subClassOf ?p }}"
        superclass = dict(row.split() for row in self._client.query_ontology(query, True, "ontology"))
        chain = [skill_type]
        while chain[0] in superclass and superclass[chain[0]] not in ("skiros:Skill", *chain):
            chain.insert(0, superclass[chain[0]])
        return chain


def _conditions(skill: Element, branch: Mapping[str, Element]) -> dict[str, list[Condition]]:
    return {
        kind: [Condition(c.label, _text(c, branch)) for c in _targets(skill, relation, branch)]
        for kind, relation in CONDITIONS.items()
    }


def _targets(element: Element, relation: str, branch: Mapping[str, Element]) -> list[Element]:
    """The elements that a relation leads to, in the order of creation."""
    ids = [r["dst"] for r in element.getRelations("-1", relation) if r["dst"] in branch]
    return [branch[eid] for eid in sorted(ids, key=id_number)]


def _text(condition: Element, branch: Mapping[str, Element]) -> str:
    """The text of a condition, from its element's properties: its class may be defined by a library."""
    parts = _targets(condition, _PARTS, branch)
    subject, on, other, operator, value = (
        condition.value_of(f"skiros:{name}")
        for name in ("hasSubject", "appliedOnType", "hasObject", "operator", "desiredValue")
    )
    kind = local_name(condition.type)
    if other is not None and "Abstract" in kind:
        text = f"the ontology allows {subject} {on} {other}"
    elif parts:
        text = f"({' or '.join(_text(part, branch) for part in parts)})"
    elif other is not None:
        text = f"{subject} {on} {other}"
    elif kind == "ConditionSignal":
        text = f"{on} of {subject} is {value}"
    elif operator is not None:
        text = f"{subject} {on} {operator} {value}"
    elif kind == "ConditionHasProperty":
        text = f"{subject} has a value of {on}"
    elif on is not None or kind == "ConditionOnType":
        text = f"{subject} is a {on or value}"
    elif kind in ("ConditionIsSpecified", "ConditionGenerate"):
        text = f"{subject} is an element of the scene"
    else:
        text = f"{kind} of {subject}"
    return text if condition.value_of("skiros:desiredState") is not False else f"not {text}"


def _reference(element: Element) -> dict[str, Any]:
    """The JSON form of an element in a parameter; the manager reads the rest from the world model."""
    known = {"id": element.id, "label": element.label, "type": element.type}
    return {**known, "last_update": 0.0, "properties": {}, "relations": []}


def stop_lines(robot: str, status: Any) -> list[str]:
    """The stops in a `SafetyStatus`, a line each; [] while there is none."""
    since = time.strftime("%H:%M:%S", time.localtime(status.since.to_sec()))
    return [f"{robot} is stopped since {since}: {status.stops[0]}", *status.stops[1:]] if status.stops else []


def present_stops(manager: ManagerPort) -> list[str]:
    """The stops of a manager's robot, a line each; [] while there is none, and when the manager does not say."""
    try:
        return stop_lines(manager.name, manager.safety())
    except SkirosError as error:
        log.debug("the safety state of %s is not known: %s", manager.name, error)
        return []


def list_skills(manager: ManagerPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Lists the skills of a robot with their parameters; optional ones are in brackets."""
    skills = sorted(manager.read_skills(), key=lambda skill: (skill.type, skill.label))
    rows = [(s.label, s.type, " ".join(_short(p) for p in _in_order(s) if p.key != "Robot")) for s in skills]
    lines = table(screen, rows, ("skill", "type", "parameters")) if rows else [f"{manager.name} has no skills"]
    return CommandResult([*present_stops(manager), *lines], [_skill_json(skill) for skill in skills])


def describe(manager: ManagerPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows the parameters, conditions and implementations of a skill."""
    skills = manager.read_skills()
    named = find_skill(arguments.skill, skills)
    world = World.of(manager)
    lines: list[str] = []
    data = []
    for skill in named.skills:
        others = [s.label for s in skills if s.type == skill.type and s is not skill]
        registered, error = _registered(world, skill)
        lines += ["", *_described(skill, others, registered, error, screen)]
        conditions = {kind: [vars(c) for c in some] for kind, some in registered.conditions.items()}
        known = {"purpose": registered.purpose, "module": registered.module, "classes": registered.classes}
        data.append({**_skill_json(skill), **known, "conditions": conditions})
    return CommandResult(lines[1:], data)


def why(manager: ManagerPort, arguments: argparse.Namespace, screen: Screen) -> CommandResult:
    """Shows why a task or its nodes failed, by default the last task that failed or was refused."""
    found = manager.why(-1 if arguments.task is None else arguments.task)
    return CommandResult(found.text.splitlines(), [explanation.to_dict() for explanation in found.explanations])


def _registered(world: World, skill: Skill) -> tuple[Registered, str]:
    """Returns the registration of a skill in the world model, and the error text when it does not answer."""
    try:
        return world.registered(skill.type, skill.label), ""
    except SkirosError as error:
        return Registered(), str(error)


def _described(skill: Skill, others: list[str], registered: Registered, error: str, screen: Screen) -> list[str]:
    facts = [
        ("type", skill.type),
        ("under", " > ".join(map(local_name, registered.classes[:-1]))),
        ("module", registered.module),
        ("also", f"{', '.join(others)} (other implementations of {skill.type})" if others else ""),
    ]
    head = f"{skill.label}: {registered.purpose}" if registered.purpose else skill.label
    lines = [screen.fitted(head), *_indented([fact for fact in facts if fact[1]], screen)]
    rows = [(p.key, p.kind, p.type, _default(p), _explained(p)) for p in _in_order(skill)]
    lines += ["", "parameters", *_indented(rows, screen)]
    for kind in CONDITIONS:
        conditions = registered.conditions.get(kind, [])
        if conditions:
            lines += ["", f"{kind}-conditions", *_indented([(c.label, c.text) for c in conditions], screen)]
    return [*lines, "", screen.fitted(f"conditions are not known: {error}")] if error else lines


def _indented(rows: Any, screen: Screen) -> list[str]:
    width = screen.width
    inner = Screen(None if width is None else max(1, width - 2), screen.fancy)
    return [f"  {line}" for line in table(inner, rows)]


def _in_order(skill: Skill) -> list[Parameter]:
    """The parameters that must be given first, then other required ones; the robot last."""
    return sorted(skill.parameters.values(), key=lambda p: (p.key == "Robot", not p.must_be_given, p.kind != REQUIRED))


def _short(parameter: Parameter) -> str:
    if parameter.default:
        return f"[{parameter.key}={_values(parameter)}]"
    return parameter.key if parameter.kind == REQUIRED else f"[{parameter.key}]"


def _default(parameter: Parameter) -> str:
    return f"= {_values(parameter)}" if parameter.default else ""


def _explained(parameter: Parameter) -> str:
    """The description, and the unit and limits."""
    return ", ".join(text for text in (parameter.description, parameter.limits.text) if text)


def _values(parameter: Parameter) -> str:
    values: list[Any] = parameter.as_json()["default"]
    if len(values) == 1:
        return values[0] if isinstance(values[0], str) else json.dumps(values[0], ensure_ascii=False)
    return json.dumps(values, ensure_ascii=False)


def _skill_json(skill: Skill) -> dict[str, Any]:
    parameters = [parameter.as_json() for parameter in skill.parameters.values()]
    return {"type": skill.type, "label": skill.label, "parameters": parameters}
