"""The private parameters of the world model's nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import rospkg
import rospy
import yaml

from skiros2_common.core.errors import ConfigurationError


def ontology_folder() -> Path:
    """The folder of the package's own ontologies.

    :raises ConfigurationError: the package `skiros2` cannot be found.
    """
    try:
        return Path(rospkg.RosPack().get_path("skiros2")) / "ontologies"
    except rospkg.ResourceNotFound:
        raise ConfigurationError("package skiros2 cannot be found: source the set-up file of its workspace") from None


def workspace_folder() -> Path:
    """`~workspace_dir`, the folder of the user's ontologies and scenes; the package's own when it is not set."""
    text = str(rospy.get_param("~workspace_dir", "")).strip()
    return Path(text).expanduser() if text else ontology_folder()


def text_list(name: str) -> list[str]:
    """A parameter that is a list of texts; a text is read as YAML, as launch files may write it.

    :raises ConfigurationError: it is something else.
    """
    value: Any = rospy.get_param(name, [])
    if isinstance(value, str):
        try:
            value = yaml.safe_load(value)
        except yaml.YAMLError:
            value = None
    value = [] if value is None or value == "" else value
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list) or not all(isinstance(item, str) for item in value):
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)}: expected a list of texts, got {value!r}")
    return [item for item in value if item]
