"""The reasoners that the ROS parameters name, for programs that use elements without a world model interface."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Collection
from typing import Any

import rosgraph
import rospy

from skiros2_common.core.discrete_reasoner import DiscreteReasoner
from skiros2_common.core.errors import FOREIGN_ERRORS, ConfigurationError
from skiros2_common.tools.plugin_loader import PluginLoader

log = logging.getLogger(__name__)

#: The packages of reasoners, relative to the namespace of the process.
PARAMETER = "wm/reasoners_pkgs"


def load_reasoners(known: Collection[str], add: Callable[[DiscreteReasoner], None]) -> bool:
    """Makes one of each kind of reasoner in the packages of the parameter.

    :param known: class names of reasoners that are there already.
    :param add: called with each new reasoner.
    :returns: whether the parameter is set; False without a master.
    """
    try:
        # Not `rospy.get_param`, which keeps the master of its first call, also one that was not there.
        packages = rosgraph.Master(rospy.get_name()).getParam(rospy.resolve_name(PARAMETER))
    except (rosgraph.MasterException, OSError) as error:
        log.debug("parameter %s cannot be read: %s", PARAMETER, error)
        return False
    for reasoner in available_reasoners(_names(packages), known):
        add(reasoner)
    return True


def available_reasoners(packages: Collection[str], known: Collection[str] = ()) -> list[DiscreteReasoner]:
    """As `new_reasoners`; a package that cannot be imported is reported and skipped."""
    found: list[DiscreteReasoner] = []
    for package in packages:
        try:
            found += new_reasoners([package], known)
        except ConfigurationError as error:
            log.warning("the world model uses reasoners of %s: %s", package, error)
    return found


def new_reasoners(packages: Collection[str], known: Collection[str] = ()) -> list[DiscreteReasoner]:
    """An instance of each reasoner class of the packages that no other class of its package is derived from.

    A module that cannot be imported, and a class whose constructor fails, are reported and skipped.

    :param known: the names of classes that are not wanted.
    :raises ConfigurationError: a package cannot be imported.
    """
    found: list[DiscreteReasoner] = []
    for package in packages:
        loader = PluginLoader()
        loader.load(package, DiscreteReasoner)
        for cls in loader:
            is_leaf = not any(issubclass(other, cls) for other in loader if other is not cls)
            if is_leaf and cls.__name__ not in known:
                try:
                    found.append(cls())
                except FOREIGN_ERRORS:
                    log.exception("reasoner %s cannot be constructed and is skipped", cls.__name__)
    return found


def _names(packages: Any) -> list[str]:
    """Names of packages from the parameter: a list, or a text as launch files may write it."""
    return re.findall(r"[\w.]+", packages) if isinstance(packages, str) else list(packages or [])
