"""Imports the plug-ins of other packages."""

from __future__ import annotations

import importlib
import logging

import rospkg

from skiros2_common.core.errors import FOREIGN_ERRORS

log = logging.getLogger(__name__)


def load_plugins(host: str) -> list[str]:
    """Imports the modules that packages export for a host in their package.xml, and returns their names.

        <export>
          <skiros2_gui plugin="my_package.window"/>
        </export>

    A module registers what it adds, such as an editor with `skills.widgets.editors.register_editor`. Modules that
    cannot be imported are logged.

    :param host: `skiros2_gui` for the window, `skiros2_task` for the task manager.
    """
    loaded = []
    packages = rospkg.RosPack()
    for package in packages.list():
        try:
            modules = packages.get_manifest(package).get_export(host, "plugin")
        except (rospkg.InvalidManifest, rospkg.ResourceNotFound) as error:
            log.warning("package %s: %s", package, error)
            continue
        for module in modules:
            try:
                importlib.import_module(module)
                loaded.append(module)
            except FOREIGN_ERRORS:
                log.exception("the plug-in %s of package %s cannot be imported", module, package)
    return loaded
