"""Parameters of the world model's nodes that clients read too."""

from __future__ import annotations

from typing import Any

import rospy

from skiros2_common.core.errors import ConfigurationError, WrongValue
from skiros2_common.core.yaml_text import read_yaml


def text_list(name: str) -> list[str]:
    """Reads a parameter that is a list of texts; a text is parsed as YAML, as launch files may write it.

    :raises ConfigurationError: the value is not a list of texts.
    """
    value: Any = rospy.get_param(name, [])
    if isinstance(value, str):
        try:
            value = read_yaml(value)
        except WrongValue as error:
            raise ConfigurationError(f"parameter {rospy.resolve_name(name)}: {error}") from None
    value = [] if value is None or value == "" else value
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)}: expected a list of texts, got {value!r}")
    return [item for item in value if item]
