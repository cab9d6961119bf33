"""Encodes skills, and the tasks of the task manager, as JSON and messages."""

from __future__ import annotations

import json
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.json_data import read_json
from skiros2_common.core.params import Param, ParamHandler
from skiros2_common.core.property import format_value
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs

_EXPECTED = {"manager": "a str", "type": "a str", "name": "a str", "ph": "an object", "children": "a list"}


class SkillHolder:
    """A skill with its parameters, and its children.

    :param manager: the agent's name (`/test_robot`); "" for any.
    :param type_in: the skill's type, or `Processor`.
    :param name: the implementation's label, or the processor's name.
    :param params_in: parameters by key.
    :param children: the holders of its children.
    """

    def __init__(
        self,
        manager: str,
        type_in: str,
        name: str,
        params_in: Any = None,
        children: list[SkillHolder] | None = None,
    ) -> None:
        self.manager = manager
        self.type = type_in
        self.name = name
        self.ph = params_in if isinstance(params_in, ParamHandler) else ParamHandler(dict(params_in or {}))
        self.children = list(children or [])

    def toMsg(self) -> Any:
        """Converts the skill to a `ResourceDescription`."""
        return msgs.ResourceDescription(self.type, self.name, utils.serializeParamMap(self.ph))

    def toJson(self) -> str:
        """Encodes the skill and its children as JSON."""
        return json.dumps(self, cls=utils.ParamsEncoder)

    def __str__(self) -> str:
        return f"{self.type}:{self.name} [{self.ph.printState()}]"


def encodeSkill(encoder: Any, obj: SkillHolder) -> dict[str, Any]:
    """Encodes a skill as a JSON object."""
    return {
        "manager": obj.manager,
        "type": obj.type,
        "name": obj.name,
        "ph": {key: utils.encodeParam(encoder, param) for key, param in obj.ph.items()},
        "children": [encodeSkill(encoder, child) for child in obj.children],
    }


def decodeSkill(obj: Any) -> SkillHolder:
    """Decodes a skill and its children from JSON text or the decoded value.

    `ph` has the parameters by key, or as a list; each is an object or its JSON text.

    :raises WrongValue: a part is missing or of a wrong type.
    :raises UnknownName: a parameter is of an unknown type.
    """
    if isinstance(obj, str):
        return deserialize_skill(obj)
    if not isinstance(obj, dict):
        raise WrongValue(f"skill: expected a JSON object, got {format_value(obj)}")
    for name, expected in (("manager", str), ("type", str), ("name", str), ("ph", (dict, list)), ("children", list)):
        if not isinstance(obj.get(name), expected):
            raise WrongValue(f"skill: expected {name!r} to be {_EXPECTED[name]}, got {format_value(obj.get(name))}")
    given = obj["ph"].items() if isinstance(obj["ph"], dict) else ((None, encoded) for encoded in obj["ph"])
    params: dict[str, Param] = {}
    for key, encoded in given:
        param = utils.decodeParam(encoded)
        if key not in (None, param.key):
            raise WrongValue(f"skill {obj['type']}: 'ph' has the parameter {param.key!r} under the key {key!r}")
        params[param.key] = param
    children = [decodeSkill(child) for child in obj["children"]]
    return SkillHolder(obj["manager"], obj["type"], obj["name"], ParamHandler(params), children)


def deserialize_skill(string: Any) -> SkillHolder:
    """Same as `decodeSkill`."""
    if not isinstance(string, str):
        return decodeSkill(string)
    try:
        decoded = read_json(string)
    except ValueError as error:
        raise WrongValue(f"skill is not JSON: {error}") from None
    if isinstance(decoded, str):
        raise WrongValue(f"skill: expected a JSON object, got {format_value(decoded)}")
    return decodeSkill(decoded)


utils.registerClass("skiros_skill::SkillHolder", SkillHolder, encodeSkill, decodeSkill)
