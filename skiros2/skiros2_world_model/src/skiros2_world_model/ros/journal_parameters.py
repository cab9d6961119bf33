"""The journal that the private parameters of the node ask for."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import rosgraph
import rospkg
import rospy

from skiros2_common.core.errors import ConfigurationError
from skiros2_world_model.core.journal import KILLED, Journal

log = logging.getLogger(__name__)

_SWITCH = {"true": True, "1": True, "": True, "false": False, "0": False}
_MEGABYTE = 1 << 20


def open_journal(workspace: Path, initial: Sequence[tuple[str, str]]) -> Journal | None:
    """The journal of this node; None when there is to be none.

    `~journal` (true, false, or a file; default true: a file for each master and node name), `~journal_recover`,
    `~journal_days`, `~journal_megabytes`, `~journal_sync`: see docs/world_model.md.

    :param workspace, initial: what the world model starts from, when it does not go on from the journal.
    :raises ConfigurationError: a parameter is of no use, or the journal is used by another node.
    """
    wanted = str(rospy.get_param("~journal", True)).strip()
    if not _SWITCH.get(wanted.lower(), True):
        return None
    path = _default_path() if wanted.lower() in _SWITCH else Path(wanted).expanduser()
    return Journal(
        path,
        json.dumps([str(workspace.absolute()), initial]),
        str(rospy.get_param("~journal_recover", KILLED)).strip(),
        _number("~journal_days", 30.0),
        int(_number("~journal_megabytes", 1024.0) * _MEGABYTE),
        bool(rospy.get_param("~journal_sync", False)),
    )


def _default_path() -> Path:
    """The nodes of one name on one master have one after the other; two masters on a machine have two."""
    host, port = rosgraph.network.parse_http_host_and_port(rosgraph.get_master_uri())
    return Path(rospkg.get_ros_home()) / "skiros2" / f"{host}_{port}{rospy.get_name()}.journal"


def _number(name: str, default: float) -> float:
    value: Any = rospy.get_param(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value >= 0:
        raise ConfigurationError(f"parameter {rospy.resolve_name(name)} is {value!r}, expected a number from 0 on")
    return float(value)
