"""Faults of skills, and skills as they are described for a check."""

from __future__ import annotations

import dis
import inspect
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from types import CodeType, FunctionType
from typing import Any

from skiros2_common.core.errors import WrongType
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import SourceLocation
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
