"""Imports the plug-ins of other packages."""

from __future__ import annotations

import importlib
import logging
import os
from collections.abc import Iterator
from pathlib import Path

import rospkg
from catkin_pkg.package import InvalidPackage, Package, parse_package

from skiros2_common.core.errors import FOREIGN_ERRORS

log = logging.getLogger(__name__)


def load_plugins(host: str) -> list[str]:
    """Imports the modules that packages export for a host in their package.xml, and returns their names.

        <export>
          <skiros2_gui plugin="my_package.window"/>
        </export>

    A module registers what it adds, such as an editor with `skills.widgets.editors.register_editor`. Modules that
    cannot be imported, and a package.xml that cannot be read, are logged and skipped.

    :param host: `skiros2_gui` for the window, `skiros2_task` for the task manager.
    """
    loaded = []
    for package in _packages():
        for export in package.exports:
            module = export.attributes.get("plugin")
            if export.tagname != host or module is None:
                continue
            try:
                importlib.import_module(module)
                loaded.append(module)
            except FOREIGN_ERRORS:
                log.exception("the plug-in %s of package %s cannot be imported", module, package.name)
    return loaded


def _packages() -> Iterator[Package]:
    """Yields the packages on ROS_PACKAGE_PATH; of equal names, the first.

    Does not list them with rospkg, which raises for all packages if one package.xml is invalid.
    """
    known = set()
    for file in _manifests():
        try:
            package = parse_package(str(file), warnings=[])
        except (InvalidPackage, OSError, ValueError) as error:
            log.warning("%s is skipped: %s", file, error)
            continue
        if package.name not in known:
            known.add(package.name)
            yield package


def _manifests() -> Iterator[Path]:
    """Yields the package.xml of each package, with the rules of rospkg: a package has no packages in its folder."""
    for path in rospkg.get_ros_paths():
        for folder, subfolders, files in os.walk(path, followlinks=True):
            if "CATKIN_IGNORE" not in files:
                if "package.xml" in files:
                    yield Path(folder) / "package.xml"
                elif "rospack_nosubdirs" not in files and not folder.startswith("/usr/share/"):
                    subfolders[:] = sorted(name for name in subfolders if not name.startswith("."))
                    continue
            subfolders.clear()
