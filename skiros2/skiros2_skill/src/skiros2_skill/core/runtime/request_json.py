"""Requests to run skills as JSON texts, as messages and commands have them."""

from __future__ import annotations

from collections.abc import Iterable

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.json_codec import decodeParam
from skiros2_common.core.json_data import read_json
from skiros2_common.core.params import Param
from skiros2_common.core.property import format_value
from skiros2_common.core.wording import short_name
from skiros2_skill.core.runtime.request import JsonValues, SkillRequest

#: The most characters of the type or label of a skill, and the most parameters: errors name each.
MAX_NAME, MAX_PARAMS = 1000, 1000


def read_request(skill_type: str, label: str, texts: Iterable[str]) -> SkillRequest:
    """Reads a request. A parameter without `specType` and `type` gets them from the skill.

    :param texts: a parameter each. Those that cannot be read are problems of the request.
    :raises WrongValue: the type or the label is too long, or it has too many parameters.
    """
    if len(skill_type) > MAX_NAME or len(label) > MAX_NAME:
        raise WrongValue(f"skill {short_name(skill_type)} {short_name(label)}: its name has over {MAX_NAME} characters")
    params: dict[str, Param | JsonValues] = {}
    problems: list[SkirosError] = []
    for index, text in enumerate(texts):
        if index == MAX_PARAMS:
            raise WrongValue(f"skill {skill_type} {label}: it has over {MAX_PARAMS} parameters")
        try:
            key, param = _read(text)
        except SkirosError as error:
            problems.append(WrongValue(f"{skill_type}, params[{index}]: {error}"))
            continue
        if key in params:
            problems.append(WrongValue(f"{skill_type}: parameter {key!r} is given twice"))
        params[key] = param
    return SkillRequest(skill_type, label, params, problems)


def _read(text: str) -> tuple[str, Param | JsonValues]:
    try:
        decoded = read_json(text)
    except ValueError as error:
        raise WrongValue(f"parameter is not JSON: {error}: {format_value(text)}") from None
    if not isinstance(decoded, dict) or not isinstance(decoded.get("key"), str):
        example = '{"key": "Duration", "values": [1.5]}'
        raise WrongValue(f"parameter: expected a JSON object such as {example}, got {format_value(text)}")
    if "specType" in decoded and "type" in decoded:
        param = decodeParam(decoded)
        return param.key, param
    if "values" not in decoded:
        raise WrongValue(f'parameter {decoded["key"]!r} has no "values"')
    values = decoded["values"]
    return decoded["key"], JsonValues(values if isinstance(values, list) else [values])
