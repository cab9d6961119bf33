"""Describes the classes of skill libraries, without calling `onInit` and without access to write the world model."""

from __future__ import annotations

import ast
import functools
import inspect
import linecache
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import FunctionType
from typing import Any

from skiros2_common.core.errors import FOREIGN_ERRORS, WrongType
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import SourceLocation, error_location, format_error_line
from skiros2_common.core.world_model_port import WorldModelPort, read_only_calls
from skiros2_skill.core.tree.compound import SkillBase

#: The hooks in which skills may declare further parameters.
_STARTS = ("onInit", "onStart", "preStart")


class ReadOnlyWorldModel:
    """The world model for checked code: only the reading methods of the port."""

    _READS = read_only_calls(WorldModelPort)

    def __init__(self, wmi: WorldModelPort | None) -> None:
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

    def __init__(self, cls: type, wmi: WorldModelPort | None) -> None:
        self.cls = cls
        self.skill = self.instance(ReadOnlyWorldModel(wmi))

    @functools.cached_property
    def is_open(self) -> bool:
        """Whether it may declare parameters at run time."""
        return any(_may_declare(name, method) for name, method in _hooks(self.cls))

    def instance(self, wmi: WorldModelPort) -> Any:
        """Creates an instance with its description."""
        skill: Any = self.cls()
        skill._wmi = wmi
        skill.declare()
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


@dataclass(frozen=True)
class Undescribed:
    """A class whose description raises.

    :param reason: what it raised, for people.
    :param location: where it was raised.
    """

    cls: type
    reason: str
    location: SourceLocation


class Descriptions:
    """The descriptions of classes that implement skills, each made on first use.

    :param wmi: the world model that descriptions may read; None: none.
    """

    def __init__(self, wmi: WorldModelPort | None, classes: Iterable[type] = ()) -> None:
        self.wmi = wmi
        self._pending = list(dict.fromkeys(classes))
        self._described: dict[type, Described | Undescribed] = {}

    def add(self, cls: type) -> None:
        """Adds a class."""
        if cls not in self._described and cls not in self._pending:
            self._pending.append(cls)

    def of(self, cls: type) -> Described | Undescribed:
        """The description of a class, which is added if necessary."""
        if cls in self._pending:
            self._pending.remove(cls)
        if cls not in self._described:
            self._described[cls] = _described(cls, self.wmi)
        return self._described[cls]

    def all(self) -> list[Described]:
        """All classes that could be described."""
        while self._pending:
            self.of(self._pending[0])
        return self._known()

    def options(self, stype: str, label: str) -> list[Described]:
        """The implementations of a type. Describes other classes only if no described one matches.

        :param label: their label or class name; "" for any.
        """
        described = [d for d in self._known() if d.skill.type == stype and label in ("", d.skill.label)]
        if described:
            return described
        typed = [d for d in self.all() if d.skill.type == stype]
        return [d for d in typed if label in ("", d.skill.label)] or [d for d in typed if is_named(d.cls, label)]

    def _known(self) -> list[Described]:
        return [d for d in self._described.values() if isinstance(d, Described)]


def _described(cls: type, wmi: WorldModelPort | None) -> Described | Undescribed:
    try:
        return Described(cls, wmi)
    except FOREIGN_ERRORS as error:
        location = error_location(error, cls.__module__) or class_location(cls)
        return Undescribed(cls, format_error_line(error), location)


def is_named(cls: type, name: str) -> bool:
    """Whether a name is the name of a class, with or without module."""
    return name in (cls.__name__, f"{cls.__module__}.{cls.__name__}")


def class_location(cls: type) -> SourceLocation:
    """The source location of a class; ("", 0) when there is no source."""
    try:
        return inspect.getsourcefile(cls) or "", inspect.getsourcelines(cls)[1]
    except (OSError, TypeError):
        return "", 0


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
    code = method.__code__
    first = code.co_varnames[0] if code.co_argcount else ""
    linecache.checkcache(code.co_filename)  # the library may have been reloaded
    functions = _functions("".join(linecache.getlines(code.co_filename))).get(code.co_firstlineno)
    if functions is None:
        return True  # without its source
    for node in (node for function in functions for node in ast.walk(function)):
        if isinstance(node, ast.Attribute) and node.attr == "addParam":
            return True
    return name in _STARTS and any(_passes_on(first, function) for function in functions)


def _passes_on(name: str, function: ast.AST) -> bool:
    """Whether a function uses a variable for more than access to its attributes."""
    accesses = {id(node.value) for node in ast.walk(function) if isinstance(node, ast.Attribute)}
    names = (node for node in ast.walk(function) if isinstance(node, ast.Name) and node.id == name)
    return any(id(node) not in accesses for node in names)


@functools.lru_cache(100)
def _functions(source: str) -> dict[int, list[ast.AST]]:
    """The functions of a module by their first line; {} for a source that cannot be parsed."""
    found: dict[int, list[ast.AST]] = {}
    try:
        tree = ast.parse(source)
    except SyntaxError:
        return found
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.Lambda):
            decorators = node.decorator_list if isinstance(node, ast.FunctionDef) else []
            line = min(part.lineno for part in (node, *decorators))
            found.setdefault(line, []).append(node)
    return found
