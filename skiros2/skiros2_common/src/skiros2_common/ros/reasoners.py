"""Loading reasoners from the packages of a ROS parameter."""

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

#: The packages with reasoners, relative to the process's namespace.
PARAMETER = "wm/reasoners_pkgs"


def load_reasoners(known: Collection[str], add: Callable[[DiscreteReasoner], None]) -> bool:
    """Creates the reasoners in the packages of the parameter.

    :param known: class names to skip.
    :param add: called with each new reasoner.
    :returns: whether the parameter is set; False without a master.
    """
    try:
        # Not `rospy.get_param`, which keeps using the master of its first call.
        packages = rosgraph.Master(rospy.get_name()).getParam(rospy.resolve_name(PARAMETER))
    except (rosgraph.MasterException, OSError) as error:
        log.debug("parameter %s cannot be read: %s", PARAMETER, error)
        return False
    for reasoner in available_reasoners(_names(packages), known):
        add(reasoner)
    return True


def available_reasoners(packages: Collection[str], known: Collection[str] = ()) -> list[DiscreteReasoner]:
    """Same as `new_reasoners`, but logs and skips a package that cannot be imported."""
    found: list[DiscreteReasoner] = []
    for package in packages:
        try:
            found += new_reasoners([package], known)
        except ConfigurationError as error:
            log.warning("the world model uses reasoners of %s: %s", package, error)
    return found


def new_reasoners(packages: Collection[str], known: Collection[str] = ()) -> list[DiscreteReasoner]:
    """Creates an instance of each reasoner class of the packages that has no subclass in its package.

    Logs and skips a module that cannot be imported and a class whose constructor fails.

    :param known: class names to skip.
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
    """The package names in the parameter: a list, or a text, as launch files may write it."""
    return re.findall(r"[\w.]+", packages) if isinstance(packages, str) else list(packages or [])
