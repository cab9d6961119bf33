"""Wire formats of skills, and of the tasks that the task manager makes."""

from __future__ import annotations

import json
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.json_text import read_json
from skiros2_common.core.params import Param, ParamHandler
from skiros2_common.ros import utils
from skiros2_msgs import msg as msgs


class SkillHolder:
    """A skill with its parameters, for a manager to run, and the skills under it.

    :param manager: the agent's name (`/test_robot`), "" when any may run it.
    :param type_in: the skill's type, or `Processor`.
    :param name: the implementation's label, or the processor's name.
    :param params_in: parameters by key.
    :param children: the holders under it.
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
        """The skill as a `ResourceDescription`."""
        return msgs.ResourceDescription(self.type, self.name, utils.serializeParamMap(self.ph))

    def toJson(self) -> str:
        """The skill and all under it as JSON."""
        return json.dumps(self, cls=utils.ParamsEncoder)


def encodeSkill(encoder: Any, obj: SkillHolder) -> dict[str, Any]:
    """The JSON form of a skill."""
    return {
        "manager": obj.manager,
        "type": obj.type,
        "name": obj.name,
        "ph": [utils.encodeParam(encoder, param) for param in obj.ph.values()],
        "children": [encodeSkill(encoder, child) for child in obj.children],
    }


def decodeSkill(obj: Any) -> SkillHolder:
    """A skill from its JSON form.

    :raises WrongValue: a part is missing or of a wrong type.
    """
    if not isinstance(obj, dict):
        raise WrongValue(f"skill: expected a JSON object, got {obj!r}")
    for name, expected in (("manager", str), ("type", str), ("name", str), ("ph", list), ("children", list)):
        if not isinstance(obj.get(name), expected):
            raise WrongValue(f"skill: expected {name!r} to be a {expected.__name__}, got {obj.get(name)!r}")
    params: dict[str, Param] = {}
    for encoded in obj["ph"]:
        param = utils.decodeParam(encoded)
        params[param.key] = param
    return SkillHolder(
        obj["manager"], obj["type"], obj["name"], params, [decodeSkill(child) for child in obj["children"]]
    )


def deserialize_skill(string: str) -> SkillHolder:
    """A skill and all under it from JSON.

    :raises WrongValue: the text is no such JSON.
    """
    try:
        decoded = read_json(string)
    except ValueError as error:
        raise WrongValue(f"skill is not JSON: {error}") from None
    return decodeSkill(decoded)


utils.registerClass("skiros_skill::SkillHolder", SkillHolder, encodeSkill, decodeSkill)
