"""What the world model knows that a manager's services do not tell: elements by name, conditions, packages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import rosgraph

from skiros2_common.core.errors import UnknownName, WrongValue
from skiros2_common.core.names import id_number, local_name
from skiros2_common.core.world_element import Element
from skiros2_skill.command_line.description import Parameter, did_you_mean
from skiros2_skill.core.manager_names import runs_on
from skiros2_world_model.command_line.connection import connect

#: Of the conditions of a skill, which relation leads to which.
CONDITIONS = {
    "pre": "skiros:hasPreCondition",
    "hold": "skiros:hasHoldCondition",
    "post": "skiros:hasPostCondition",
}
_PARTS = "skiros:hasCondition"


@dataclass(frozen=True)
class Condition:
    """A condition as it is declared.

    :param text: in words, of the keys of the parameters.
    """

    label: str
    text: str


@dataclass(frozen=True)
class Registered:
    """What is registered of a skill.

    :param purpose: what it is for, in a sentence or two; "" when its description does not say.
    :param module: the Python module that implements it; "" when the manager does not tell.
    :param conditions: by the keys of `CONDITIONS`.
    :param classes: those that it is under, from the one of its package down to its own.
    """

    purpose: str = ""
    module: str = ""
    conditions: dict[str, list[Condition]] = field(default_factory=dict)
    classes: list[str] = field(default_factory=list)


class World:
    """The world model of a manager, asked when something is first needed of it.

    :param manager: the manager's node name; the world model is `wm` in its namespace.
    :param author: who asks.
    """

    def __init__(self, manager: str, author: str) -> None:
        self._name = rosgraph.names.ns_join(rosgraph.names.namespace(manager), "wm")
        self._manager = manager
        self._author = author
        self._wm: Any = None

    @property
    def _asked(self) -> Any:
        if self._wm is None:
            self._wm = connect(self._name, self._author)
        return self._wm

    def find_element(self, declared: Parameter, name: str) -> Any:
        """The element with that id, or of the parameter's class with that label, as JSON has it.

        :raises UnknownName: there is none.
        :raises WrongValue: there are several with that label.
        :raises Unavailable: the world model does not answer.
        """
        found = self._asked.find_element(name) if name else None
        matching = [found] if found is not None else self._asked.resolve_elements(Element(declared.type, name))
        if len(matching) == 1 and name:
            return _reference(matching[0])
        if matching and name:
            ids = ", ".join(element.id for element in matching)
            raise WrongValue(f"{len(matching)} elements are labelled {name!r}, {ids}: give the id")
        known = self._asked.resolve_elements(Element(declared.type))
        names = [word for element in known for word in (element.label, element.id) if word]
        raise UnknownName(f"there is no {declared.type} with the id or label {name!r}; {did_you_mean(name, names)}")

    def registered(self, skill_type: str, label: str) -> Registered:
        """What is registered of a skill of the manager.

        :raises UnknownName: the manager has registered no such skill.
        :raises Unavailable: the world model does not answer.
        """
        for eid in self._skill_ids():
            if eid.rpartition("-")[0] == skill_type:
                branch = {element.id: element for element in self._asked.get_branch(eid, "skiros:skillProperty")}
                skill = branch[eid]
                if skill.label == label:
                    purpose, module = (skill.value_of(key) or "" for key in ("rdfs:comment", "skiros:PythonModule"))
                    return Registered(purpose, module, _conditions(skill, branch), self._classes(skill_type))
        raise UnknownName(f"{self._manager} has registered no skill {skill_type}-{label}")

    def _skill_ids(self) -> list[str]:
        robots = [r for r in self._asked.resolve_elements(Element("cora:Robot")) if runs_on(r, self._manager)]
        relations = (r.getRelations("-1", "skiros:hasSkill") for r in robots)
        return [relation["dst"] for some in relations for relation in some]

    def _classes(self, skill_type: str) -> list[str]:
        """The classes between `skiros:Skill` and a type, and itself last."""
        query = f"SELECT ?c ?p {{ {skill_type} rdfs:subClassOf* ?c . ?c rdfs:subClassOf ?p }}"
        above = dict(row.split() for row in self._asked.query_ontology(query, True, "ontology"))
        chain = [skill_type]
        while chain[0] in above and above[chain[0]] not in ("skiros:Skill", *chain):
            chain.insert(0, above[chain[0]])
        return chain


def _conditions(skill: Element, branch: Mapping[str, Element]) -> dict[str, list[Condition]]:
    return {
        kind: [Condition(c.label, _text(c, branch)) for c in _under(skill, relation, branch)]
        for kind, relation in CONDITIONS.items()
    }


def _under(element: Element, relation: str, branch: Mapping[str, Element]) -> list[Element]:
    """What an element leads to, in the order in which it was made."""
    ids = [r["dst"] for r in element.getRelations("-1", relation) if r["dst"] in branch]
    return [branch[eid] for eid in sorted(ids, key=id_number)]


def _text(condition: Element, branch: Mapping[str, Element]) -> str:
    """A condition in words, by what its element has: conditions may be of classes that a library has made."""
    parts = _under(condition, _PARTS, branch)
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
    """An element as parameters hold it; the manager reads the rest of it in the world model."""
    known = {"id": element.id, "label": element.label, "type": element.type}
    return {**known, "last_update": 0.0, "properties": {}, "relations": []}
