"""Requests to run skills and the parameters of results as JSON texts, as messages and commands have them."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Mapping

from skiros2_common.core.errors import SkirosError, WrongValue
from skiros2_common.core.json_codec import ParamsEncoder, decodeParam
from skiros2_common.core.json_data import read_json
from skiros2_common.core.params import Param
from skiros2_common.core.property import format_value
from skiros2_skill.core.runtime.request import JsonValues, SkillRequest

log = logging.getLogger(__name__)


def read_request(skill_type: str, label: str, texts: Iterable[str]) -> SkillRequest:
    """Reads a request. A parameter without `specType` and `type` gets them from the skill.

    :param texts: a parameter each. Those that cannot be read are problems of the request.
    """
    params: dict[str, Param | JsonValues] = {}
    problems: list[SkirosError] = []
    for index, text in enumerate(texts):
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


def param_texts(params: Mapping[str, Param]) -> list[str]:
    """Encodes parameters; those with values that have no JSON form are left out."""
    texts = []
    for param in params.values():
        try:
            texts.append(json.dumps(param, cls=ParamsEncoder))
        except (SkirosError, TypeError, ValueError, RecursionError) as error:
            log.debug("parameter %r has no JSON form: %s", param.key, error)
    return texts
