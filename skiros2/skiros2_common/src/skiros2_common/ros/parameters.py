"""Checked ROS parameters of nodes."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import Any

import rospy

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.yaml_text import read_yaml

_LARGEST = sys.float_info.max


def number_param(
    name: str,
    default: float,
    *,
    above: float = -math.inf,
    minimum: float = -math.inf,
    maximum: float = _LARGEST,
    what: str = "a number",
    is_whole: bool = False,
    get: Callable[[str, Any], Any] = rospy.get_param,
) -> float:
    """Reads a number.

    :param above, minimum, maximum: limits, the first of them exclusive; inf is allowed if it is the maximum.
    :param what: in the error's text.
    :param is_whole: whether fractions are refused.
    :param get: another source than the parameter server.
    :raises ConfigurationError: the parameter has another value.
    """
    value = get(name, default)
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and not (is_whole and value % 1)
    if not is_number or not minimum <= value <= maximum or not value > above:
        limits = [f"above {above:g}"] if above > -math.inf else [f"from {minimum:g}"] if minimum > -math.inf else []
        limits += [f"up to {maximum:g}"] if maximum < _LARGEST else []
        where = rospy.resolve_name(name) if get is rospy.get_param else name
        expected = " ".join([what, " and ".join(limits)]).strip()
        raise ConfigurationError(f"parameter {where} is {value!r:.60}, expected {expected}")
    return float(value)


def integer_param(name: str, default: int, **limits: Any) -> int:
    """Reads an integer within limits, as of `number_param`.

    :raises ConfigurationError: the parameter has another value.
    """
    return int(number_param(name, default, what="an integer", is_whole=True, **limits))


def bool_param(name: str, default: bool) -> bool:
    """Reads true or false.

    :raises ConfigurationError: the parameter has another value.
    """
    value: Any = rospy.get_param(name, default)
    if not isinstance(value, bool):
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r:.60}, expected true or false")
    return value


def texts_param(name: str) -> list[str]:
    """Reads a list of texts; [] if it is missing or empty. A text is parsed as YAML, as launch files may write it.

    :raises ConfigurationError: the parameter has another value.
    """
    value: Any = rospy.get_param(name, [])
    if isinstance(value, str):
        try:
            value = read_yaml(value)
        except WrongValue as error:
            raise ConfigurationError(f"parameter {rospy.resolve_name(name)}: {error}") from None
    found = [value] if isinstance(value, str) else value or []
    if not isinstance(found, list) or not all(isinstance(item, str) for item in found):
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected a list of texts")
    return [item for item in found if item]
