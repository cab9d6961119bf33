"""Checks skills before they run, from their descriptions and trees alone.

Nothing that depends on parameter values, or may be added while a skill runs, is a fault. Faults do not prevent loading:
a warning states the consequence, an error means that the skill cannot run.
"""

from __future__ import annotations

import dis
import inspect
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from types import CodeType, FunctionType
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, WrongType
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import SourceLocation, error_location, format_error_line
from skiros2_common.tools.plugin_loader import PluginLoader
from skiros2_skill.core.tree.compound import SkillBase
from skiros2_world_model.core.world_model_abstract_interface import WorldModelPort, read_only_calls

ERROR, WARNING, NOTE = "error", "warning", "note"

#: The hooks in which skills may declare further parameters.
_STARTS = ("onInit", "onStart", "preStart")

UNKNOWN_SKILL, NOT_DESCRIBED = "unknown-skill", "not-described"


@dataclass(frozen=True)
class Fault:
    """A fault of a skill.

    :param severity: `ERROR`, `WARNING` or `NOTE`.
    :param code: the kind of fault.
    :param skill: `type-label`.
    :param file, line: the source location; "" and 0 when it is not known.
    :param done: the consequence when the skill is loaded and run.
    """

    severity: str
    code: str
    skill: str
    text: str
    file: str = ""
    line: int = 0
    done: str = ""

    def __str__(self) -> str:
        done = f" ({self.done})" if self.done else ""
        return f"{self.file}:{self.line}: {self.severity}: [{self.code}] {self.skill}: {self.text}{done}"

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)


class ReadOnlyWorldModel:
    """The world model for checked code: only the reading methods of the port."""

    _READS = read_only_calls(WorldModelPort)

    def __init__(self, wmi: Any) -> None:
        self.__wmi = wmi

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # `copy` looks these up
            raise AttributeError(name)
        if self.__wmi is None or name not in self._READS:
            raise WrongType(f"the skill is only checked; wmi.{name} is not available then")
        return getattr(self.__wmi, name)


class Described:
    """A class that implements a skill, with its description. `onInit` is not called.

    :raises Exception: raised by its constructor or `createDescription`.
    """

    def __init__(self, cls: type, wmi: Any) -> None:
        self.cls = cls
        self.skill = self.instance(ReadOnlyWorldModel(wmi))
        #: Whether it may declare parameters at run time.
        self.is_open = any(_may_declare(name, method) for name, method in _hooks(cls))

    def instance(self, wmi: Any) -> Any:
        """Creates an instance with its description."""
        skill: Any = self.cls()
        skill._wmi = wmi
        skill._create()
        return skill

    @property
    def declared(self) -> Any:
        """Same as `Implementation.declared`."""
        return self.skill

    @property
    def name(self) -> str:
        return f"{self.skill.type}-{self.skill.label}"

    @property
    def is_compound(self) -> bool:
        return isinstance(self.skill, SkillBase)

    def fault(self, severity: str, code: str, text: str, place: SourceLocation | None = None, done: str = "") -> Fault:
        """Creates a fault of the skill.

        :param place: its source location; None: that of the class.
        """
        file, line = place or class_location(self.cls)
        return Fault(severity, code, self.name, text, file, line, done)


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
        from skiros2_skill.core.lint.description import description_faults
        from skiros2_skill.core.lint.tree import tree_faults

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


def class_location(cls: type) -> SourceLocation:
    """The source location of a class; ("", 0) when there is no source."""
    try:
        return inspect.getsourcefile(cls) or "", inspect.getsourcelines(cls)[1]
    except (OSError, TypeError):
        return "", 0


def _not_imported(module: str, cause: str) -> Fault:
    place = re.match(r"(.+), line (\d+): (.*)", cause, re.DOTALL)
    file, line, text = place.groups() if place else ("", "0", cause)
    return Fault(ERROR, "not-imported", module, text, file, int(line))


def _undescribed(cls: type, error: Exception | SystemExit) -> Fault:
    file, line = error_location(error, cls.__module__) or class_location(cls)
    text = f"describing it raised {format_error_line(error)}"
    return Fault(ERROR, NOT_DESCRIBED, cls.__name__, text, file, line, "the skill is skipped")


def _hooks(cls: type) -> Iterator[tuple[str, FunctionType]]:
    """The methods of a class that are not inherited from the platform and do not describe it."""
    for base in cls.__mro__:
        if base in (PrimitiveBase, SkillBase):
            return
        for name, method in vars(base).items():
            if isinstance(method, FunctionType) and name not in ("createDescription", "modifyDescription", "expand"):
                yield name, method


def _may_declare(name: str, method: FunctionType) -> bool:
    """Whether a method may add a parameter: itself or, in a start hook, through a function that gets the skill."""
    loaded = ("LOAD_FAST", "LOAD_DEREF", "LOAD_CLOSURE")
    for code in _codes(method.__code__):
        if "addParam" in code.co_names:
            return True
        before: dis.Instruction | None = None
        for step in dis.get_instructions(code) if name in _STARTS else ():
            # `self.x` is an attribute access; any other use of `self` passes it on
            if before is not None and step.opname not in ("LOAD_ATTR", "LOAD_METHOD", "STORE_ATTR"):
                return True
            mine = step.opname in loaded and step.argval == _first_argument(method)
            before = step if mine and step.opname != "LOAD_CLOSURE" else None
    return False


def _first_argument(method: FunctionType) -> str:
    return method.__code__.co_varnames[0] if method.__code__.co_argcount else ""


def _codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a function and of its nested functions."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)
