"""Finds the subclasses of a class in a package and its subpackages."""

from __future__ import annotations

import builtins
import importlib
import inspect
import logging
import pkgutil
import re
import sys
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from types import ModuleType
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, MissingPackage, UnknownName
from skiros2_common.core.names import nearest

log = logging.getLogger(__name__)

#: The modules of ROS: its tools, clients and messages.
_ROS_MODULE = re.compile(
    r"ros(py|lib|graph|pkg|bag|launch|master|msg|node|param|service|topic|unit)|tf2?(_\w+)?|actionlib\w*|catkin_pkg|"
    r"cv_bridge|dynamic_reconfigure|gen(py|msg)|message_filters|moveit_commander|\w+_(msgs|srvs)"
)


@dataclass(frozen=True)
class ImportFailure:
    """Why a module cannot be imported.

    :param text: the error, for people.
    :param file, line: its source location; "" and 0 when it is not known.
    :param missing: the module that is not installed; "" for other errors.
    """

    text: str
    file: str = ""
    line: int = 0
    missing: str = ""

    @property
    def needs_ros(self) -> bool:
        """Whether the module uses ROS, which is not installed."""
        return bool(_ROS_MODULE.fullmatch(self.missing.partition(".")[0])) and find_spec("rospy") is None

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}: {self.text}" if self.file else self.text


class PluginLoader:
    """The plugins of some packages. Logs and skips modules that cannot be imported.

    `failures` maps the name of each such module to the cause.
    """

    def __init__(self) -> None:
        self._plugins: dict[str, type] = {}
        self.failures: dict[str, ImportFailure] = {}

    def signature(self, plugin: type) -> str:
        """`module.Class`."""
        return f"{plugin.__module__}.{plugin.__name__}"

    def split(self, plugin: type) -> tuple[str, str]:
        """The module and the class name."""
        return plugin.__module__, plugin.__name__

    def match(self, plugin: type, desc: Any = None) -> bool:
        """Whether the plugin has the name `desc`, with or without its module; None matches all."""
        return desc is None or desc in (plugin.__name__, self.signature(plugin))

    def instance(self, plugin: type, args_dict: dict[str, Any]) -> Any:
        """A new instance."""
        return plugin(**args_dict)

    def load(self, folder: Any, base_class: Any) -> None:
        """Same as `find`."""
        self.find(folder, base_class)

    def find(self, folder: Any, base_class: Any) -> builtins.list[type]:
        """Adds the subclasses of `base_class` (a class or a tuple) defined in a package and its subpackages.

        :param folder: the package's name, or the imported package.
        :returns: the plugins found by this call.
        :raises MissingPackage: the package is missing or cannot be imported.
        """
        package = folder if isinstance(folder, ModuleType) else self._import_package(folder)
        found: list[type] = []
        for module in self._modules(package):
            for _, cls in inspect.getmembers(module, inspect.isclass):
                if issubclass(cls, base_class) and cls.__module__ == module.__name__ and not inspect.isabstract(cls):
                    self._plugins[self.signature(cls)] = cls
                    found.append(cls)
        return found

    def __iter__(self) -> Iterator[type]:
        """The plugins in the order of loading."""
        return iter([*self._plugins.values()])

    def size(self) -> int:
        return len(self._plugins)

    def create(self, args_dict: dict[str, Any] = {}) -> builtins.list[Any]:  # noqa: B006 - the contract's default, never changed
        """A new instance of each plugin."""
        return [self.instance(plugin, args_dict) for plugin in self]

    def named(self, name: str) -> type | None:
        """The first plugin of this name, with or without its module; None if there is none."""
        return next((p for p in self if self.match(p, name)), None)

    def getPluginByName(self, name: str) -> type:
        """The first plugin of this name, with or without its module.

        :raises UnknownName: there is none.
        """
        found = self.named(name)
        if found is None:
            names = [plugin.__name__ for plugin in self]
            near = nearest(name, names) or sorted(names)
            raise UnknownName(f"unknown plugin {name!r}; known: {', '.join(near) or 'none'}")
        return found

    def list(self) -> builtins.list[str]:
        """Prints the names of all plugins, a line each, and returns them."""
        names = [plugin.__name__ for plugin in self]
        sys.stdout.write("".join(f"{name}\n" for name in names))
        return names

    def _import_package(self, name: str) -> ModuleType:
        try:
            return importlib.import_module(name)
        except FOREIGN_ERRORS as error:
            missing = error.name if isinstance(error, ModuleNotFoundError) else None
            if missing and f"{name}.".startswith(f"{missing}."):
                problem = f"there is no Python package of that name{_near(missing)}"
                raise MissingPackage(f"library {name!r}: {problem}") from None
            raise MissingPackage(f"library {name!r} cannot be imported: {_cause(error)}") from error

    def _modules(self, package: ModuleType) -> builtins.list[ModuleType]:
        modules = [package]
        found = pkgutil.iter_modules(getattr(package, "__path__", []), package.__name__ + ".")
        for name in sorted(info.name for info in found):
            try:
                module = importlib.import_module(name)
            except FOREIGN_ERRORS as error:
                self.failures[name] = _cause(error)
                failure = self.failures[name]
                level = logging.DEBUG if failure.needs_ros else logging.ERROR
                log.log(level, "module %s cannot be imported and is skipped: %s", name, failure)
            else:
                modules += self._modules(module)
        return modules


def _near(missing: str) -> str:
    """A hint with the modules whose names are nearest to a missing one; "" if none is near."""
    parent = missing.rpartition(".")[0]
    path = getattr(sys.modules[parent], "__path__", []) if parent else None
    near = nearest(missing, (f"{parent}.{each.name}".strip(".") for each in pkgutil.iter_modules(path)))
    return f"; near: {', '.join(near)}" if near else ""


def _cause(error: Exception | SystemExit) -> ImportFailure:
    """The error with its source location."""
    if isinstance(error, SyntaxError):
        return ImportFailure(error.msg, error.filename or "", error.lineno or 0)
    text = f"{type(error).__name__}: {error}"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if "importlib" not in f.filename]
    file, line = (frames[-1].filename, frames[-1].lineno or 0) if frames else ("", 0)
    missing = error.name if isinstance(error, ModuleNotFoundError) else ""
    return ImportFailure(text, file, line, missing or "")
