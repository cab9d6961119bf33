"""What a skill declares, as JSON data: its parameters and conditions, without texts for people.

Managers publish it, so that recordings have it, and a re-run compares it with the skills of then and now.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any

from skiros2_common.core.json_codec import param_texts
from skiros2_common.core.world_element import Element
from skiros2_skill.core.library.library import Implementation

#: The version of this form. One that compares differently has another number.
VERSION = 1

_CONDITIONS = {
    "skiros:hasPreCondition": "pre-condition",
    "skiros:hasHoldCondition": "hold-condition",
    "skiros:hasPostCondition": "post-condition",
    "skiros:hasCondition": "condition",
}
_FOR_PEOPLE = ("description", "key")

#: Values by name, of each part by its name: `parameter MaxForce`, `pre-condition RobotAtStart`; "": of the skill.
Declaration = dict[str, dict[str, Any]]


def declaration(implementation: Implementation) -> Declaration:
    """Returns what an implementation declares. Values that have no JSON form are left out."""
    declared = implementation.declared
    element = declared.toElement()
    found: Declaration = {"": _values(element)}
    for text in param_texts(declared.params.getParamMap()):
        param = json.loads(text)
        found[f"parameter {param['key']}"] = {k: v for k, v in param.items() if k not in _FOR_PEOPLE}
    _add_conditions(found, element, "")
    return found


def declarations_json(implementations: Iterable[Implementation]) -> str:
    """Returns the declarations of implementations, as managers publish them."""
    skills = [
        {"type": i.type, "label": i.label, "module": i.module, "declares": declaration(i)} for i in implementations
    ]
    return json.dumps({"version": VERSION, "skills": skills})


def _add_conditions(found: Declaration, element: Element, path: str) -> None:
    for _, relation, condition in element.local_relations:
        if relation in _CONDITIONS:
            name = f"{path} {_CONDITIONS[relation]} {condition.label}".strip()
            found[name] = _values(condition)
            _add_conditions(found, condition, name)


def _values(element: Element) -> dict[str, Any]:
    return {"class": element.type, **{key: list(prop.values) for key, prop in element.property_view.items()}}
