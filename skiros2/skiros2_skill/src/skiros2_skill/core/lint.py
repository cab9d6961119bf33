"""Checks of skills before they run: what can be told from descriptions and trees alone.

Whatever depends on values, or may be added while a skill runs, is no fault. No fault keeps a skill from loading: a
warning tells what becomes of it, an error that it cannot run so.
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
from skiros2_skill.core.compound import SkillBase
from skiros2_world_model.core.world_model_abstract_interface import WorldModelPort, read_only_calls

ERROR, WARNING, NOTE = "error", "warning", "note"

#: The hooks in which skills declare what depends on where they run.
_STARTS = ("onInit", "onStart", "preStart")

UNKNOWN_SKILL, NOT_DESCRIBED = "unknown-skill", "not-described"


@dataclass(frozen=True)
class Fault:
    """Something that is wrong with a skill.

    :param severity: `ERROR`, `WARNING` or `NOTE`.
    :param code: a name for the kind of fault.
    :param skill: `type-label`.
    :param file, line: where; "" and 0 when the source is not known.
    :param done: what is done about it when the skill is loaded and run.
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


class OnlyReads:
    """The world model for code that is only tried: it has what the port has for reading, and no more."""

    _READS = read_only_calls(WorldModelPort)

    def __init__(self, wmi: Any) -> None:
        self.__wmi = wmi

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # a copy asks for these
            raise AttributeError(name)
        if self.__wmi is None or name not in self._READS:
            raise WrongType(f"the skill is only checked; wmi.{name} is not available then")
        return getattr(self.__wmi, name)


class Described:
    """A class that implements a skill, with what it declares, not made ready to run: its `onInit` is not called.

    :raises Exception: what its constructor or `createDescription` raises.
    """

    def __init__(self, cls: type, wmi: Any) -> None:
        self.cls = cls
        self.skill = self.instance(OnlyReads(wmi))
        #: Whether it may declare parameters while it runs.
        self.is_open = any(_may_declare(name, method) for name, method in _hooks(cls))

    def instance(self, wmi: Any) -> Any:
        """One more, described."""
        skill: Any = self.cls()
        skill._wmi = wmi
        skill._create()
        return skill

    @property
    def declared(self) -> Any:
        """As `Implementation.declared`."""
        return self.skill

    @property
    def name(self) -> str:
        return f"{self.skill.type}-{self.skill.label}"

    @property
    def is_compound(self) -> bool:
        return isinstance(self.skill, SkillBase)

    def fault(self, severity: str, code: str, text: str, place: SourceLocation | None = None, done: str = "") -> Fault:
        """A fault of it, there or, when that is not known, where the class begins."""
        file, line = place or class_place(self.cls)
        return Fault(severity, code, self.name, text, file, line, done)


class Linter:
    """Checks the skills of some libraries.

    :param classes: all classes that implement skills.
    :param wmi: the world model, whose ontologies are asked; None: names are not looked up.
    """

    def __init__(self, classes: Iterable[type], wmi: Any = None) -> None:
        self.wmi = wmi
        self._waiting = list(classes)
        self._described: dict[type, Described | Fault] = {}
        self._cycles: dict[frozenset[type], tuple[type, SourceLocation | None]] = {}

    def add(self, cls: type) -> None:
        """One more class that implements a skill."""
        if cls not in self._described and cls not in self._waiting:
            self._waiting.append(cls)

    def lint(self, cls: type, tree: bool = True) -> list[Fault]:
        """What is wrong with the skill that a class implements, by file and line.

        :param tree: whether a compound's `expand` is tried and its tree checked too.
        """
        from skiros2_skill.core.lint_description import description_faults
        from skiros2_skill.core.lint_tree import tree_faults

        found = self.describe(cls)
        if isinstance(found, Fault):
            return [found]
        faults = [*description_faults(found, self.wmi), *(tree_faults(found, self) if tree else ())]
        return _in_order(faults)

    def options(self, stype: str, label: str) -> list[Described]:
        """The implementations of a type, with that label, or else class name, where one is given."""
        return self._matching(stype, label) or self._matching(stype, label, all_of_them=True)

    def tells_cycle(self, classes: Iterable[type], cls: type, place: SourceLocation | None) -> bool:
        """Whether it is there that some classes are told to contain each other: the place that asks first."""
        return self._cycles.setdefault(frozenset(classes), (cls, place)) == (cls, place)

    def all(self) -> list[Described]:
        """All that could be described."""
        while self._waiting:
            self.describe(self._waiting[0])
        return [d for d in self._described.values() if isinstance(d, Described)]

    def _matching(self, stype: str, label: str, all_of_them: bool = False) -> list[Described]:
        known = self.all() if all_of_them else [d for d in self._described.values() if isinstance(d, Described)]
        typed = [d for d in known if d.skill.type == stype]
        labelled = [d for d in typed if label in ("", d.skill.label)]
        return labelled or [d for d in typed if all_of_them and is_named(d.cls, label)]

    def describe(self, cls: type) -> Described | Fault:
        """What a class declares, or why that is not known."""
        if cls in self._waiting:
            self._waiting.remove(cls)
        if cls not in self._described:
            try:
                self._described[cls] = Described(cls, self.wmi)
            except FOREIGN_ERRORS as error:
                self._described[cls] = _undescribed(cls, error)
        return self._described[cls]


def is_named(cls: type, name: str) -> bool:
    """Whether a name is that of a class, with its module or without."""
    return name in (cls.__name__, f"{cls.__module__}.{cls.__name__}")


def lint_libraries(packages: Sequence[str], wmi: Any = None, used: Sequence[str] = ()) -> list[Fault]:
    """What is wrong with the skills of some Python packages, and with modules that cannot be imported.

    :param used: further packages, whose skills the trees may use.
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


def class_place(cls: type) -> SourceLocation:
    """The file and line in which a class begins; ("", 0) when the source is not there."""
    try:
        return inspect.getsourcefile(cls) or "", inspect.getsourcelines(cls)[1]
    except (OSError, TypeError):
        return "", 0


def _not_imported(module: str, cause: str) -> Fault:
    place = re.match(r"(.+), line (\d+): (.*)", cause, re.DOTALL)
    file, line, text = place.groups() if place else ("", "0", cause)
    return Fault(ERROR, "not-imported", module, text, file, int(line))


def _undescribed(cls: type, error: Exception | SystemExit) -> Fault:
    file, line = error_location(error, cls.__module__) or class_place(cls)
    text = f"describing it raised {format_error_line(error)}"
    return Fault(ERROR, NOT_DESCRIBED, cls.__name__, text, file, line, "the skill is skipped")


def _hooks(cls: type) -> Iterator[tuple[str, FunctionType]]:
    """The methods of a class, by name, but for those that describe it, and those of the base classes."""
    for base in cls.__mro__:
        if base in (PrimitiveBase, SkillBase):
            return
        for name, method in vars(base).items():
            if isinstance(method, FunctionType) and name not in ("createDescription", "modifyDescription", "expand"):
                yield name, method


def _may_declare(name: str, method: FunctionType) -> bool:
    """Whether a method may add a parameter: by itself or, at the start, in a function that it gives the skill to."""
    loaded = ("LOAD_FAST", "LOAD_DEREF", "LOAD_CLOSURE")
    for code in _codes(method.__code__):
        if "addParam" in code.co_names:
            return True
        before: dis.Instruction | None = None
        for step in dis.get_instructions(code) if name in _STARTS else ():
            # `self.x` is a use of its own; a `self` that is loaded for something else is passed on
            if before is not None and step.opname not in ("LOAD_ATTR", "LOAD_METHOD", "STORE_ATTR"):
                return True
            mine = step.opname in loaded and step.argval == _first_argument(method)
            before = step if mine and step.opname != "LOAD_CLOSURE" else None
    return False


def _first_argument(method: FunctionType) -> str:
    return method.__code__.co_varnames[0] if method.__code__.co_argcount else ""


def _codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a function and of those that are defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)
