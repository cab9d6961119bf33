"""Checks skills before they run, from their descriptions and trees alone.

Nothing that depends on parameter values, or may be added while a skill runs, is a fault. Faults do not prevent loading:
a warning states the consequence, an error means that the skill cannot run.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import SourceLocation, error_location, format_error_line
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.core.lint.description import description_faults
from skiros2_skill.core.lint.faults import ERROR, NOT_DESCRIBED, Described, Fault, class_location
from skiros2_skill.core.lint.tree import tree_faults
from skiros2_skill.core.tree.compound import SkillBase


class Linter:
    """Checks the skills of libraries.

    :param classes: all classes that implement skills.
    :param wmi: the world model with the ontologies; None: names are not looked up.
    """

    def __init__(self, classes: Iterable[type], wmi: Any = None) -> None:
        self.wmi = wmi
        self._pending = list(classes)
        self._described: dict[type, Described | Fault] = {}
        self._cycles: dict[frozenset[type], tuple[type, SourceLocation | None]] = {}

    def add(self, cls: type) -> None:
        """Adds a class that implements a skill."""
        if cls not in self._described and cls not in self._pending:
            self._pending.append(cls)

    def lint(self, cls: type, tree: bool = True) -> list[Fault]:
        """The faults of the skill that a class implements, ordered by file and line.

        :param tree: whether a compound is expanded and its tree is checked too.
        """
        found = self.describe(cls)
        if isinstance(found, Fault):
            return [found]
        faults = [*description_faults(found, self.wmi), *(tree_faults(found, self) if tree else ())]
        return _in_order(faults)

    def options(self, stype: str, label: str) -> list[Described]:
        """The implementations of a type.

        :param label: their label or class name; "" for any.
        """
        return self._matching(stype, label) or self._matching(stype, label, all_of_them=True)

    def reports_cycle(self, classes: Iterable[type], cls: type, place: SourceLocation | None) -> bool:
        """Whether to report a cycle of classes at this source location: only the first caller reports it."""
        return self._cycles.setdefault(frozenset(classes), (cls, place)) == (cls, place)

    def all(self) -> list[Described]:
        """All classes that could be described."""
        while self._pending:
            self.describe(self._pending[0])
        return [d for d in self._described.values() if isinstance(d, Described)]

    def _matching(self, stype: str, label: str, all_of_them: bool = False) -> list[Described]:
        known = self.all() if all_of_them else [d for d in self._described.values() if isinstance(d, Described)]
        typed = [d for d in known if d.skill.type == stype]
        labelled = [d for d in typed if label in ("", d.skill.label)]
        return labelled or [d for d in typed if all_of_them and is_named(d.cls, label)]

    def describe(self, cls: type) -> Described | Fault:
        """Describes a class; the fault when that fails."""
        if cls in self._pending:
            self._pending.remove(cls)
        if cls not in self._described:
            try:
                self._described[cls] = Described(cls, self.wmi)
            except FOREIGN_ERRORS as error:
                self._described[cls] = _undescribed(cls, error)
        return self._described[cls]


def is_named(cls: type, name: str) -> bool:
    """Whether a name is the name of a class, with or without module."""
    return name in (cls.__name__, f"{cls.__module__}.{cls.__name__}")


def lint_libraries(packages: Sequence[str], wmi: Any = None, used: Sequence[str] = ()) -> list[Fault]:
    """The faults of the skills in Python packages, including modules that cannot be imported.

    :param used: further packages with skills that the trees may use.
    :raises ConfigurationError: a package does not exist or cannot be imported.
    """
    bases = (PrimitiveBase, SkillBase)
    loader, others = PluginLoader(), PluginLoader()
    for package in packages:
        loader.load(package, bases)
    for package in used:
        others.load(package, bases)
    linter = Linter(dict.fromkeys([*loader, *others]), wmi)
    faults = [_not_imported(module, cause) for module, cause in loader.failures.items()]
    return _in_order(faults + [fault for cls in loader for fault in linter.lint(cls)])


def _in_order(faults: Iterable[Fault]) -> list[Fault]:
    return sorted(dict.fromkeys(faults), key=lambda fault: (fault.file, fault.line, fault.code, fault.text))


def _not_imported(module: str, cause: str) -> Fault:
    place = re.match(r"(.+), line (\d+): (.*)", cause, re.DOTALL)
    file, line, text = place.groups() if place else ("", "0", cause)
    return Fault(ERROR, "not-imported", module, text, file, int(line))


def _undescribed(cls: type, error: Exception | SystemExit) -> Fault:
    file, line = error_location(error, cls.__module__) or class_location(cls)
    text = f"describing it raised {format_error_line(error)}"
    return Fault(ERROR, NOT_DESCRIBED, cls.__name__, text, file, line, "the skill is skipped")
