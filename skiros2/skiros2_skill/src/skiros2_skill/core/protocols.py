"""Protocols of the library, as the tree and the engine see it.

Those of nodes and the executor are in `engine/skill_run.py`; the world model is `WorldModelPort` in `skiros2_common`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from skiros2_common.core.abstract_skill import SkillCore
from skiros2_common.core.world_model_port import WorldModelPort


class ImplementationPort(Protocol):
    """A class that implements a skill."""

    @property
    def type(self) -> str: ...
    @property
    def label(self) -> str: ...
    @property
    def module(self) -> str:
        """The Python module that defines the class."""

    @property
    def is_compound(self) -> bool: ...
    @property
    def runs_after_children(self) -> bool:
        """Whether it is a compound with an `execute` of its own."""

    @property
    def declared(self) -> Any:
        """An instance that never runs; it has the description."""

    def acquire(self) -> Any:
        """Returns an instance for exclusive use until it is released.

        :raises ConfigurationError: no instance can be created.
        """

    def release(self, instance: SkillCore) -> None:
        """Takes back an instance for reuse."""

    def count(self, change: int) -> None:
        """Changes the number of running instances by 1 or -1."""


class Library(Protocol):
    """The skills that a tree may name."""

    @property
    def wmi(self) -> WorldModelPort | None: ...
    def candidates(self, stype: str, label: str) -> Sequence[ImplementationPort]:
        """The implementations of a type, with a label if one is given.

        :raises UnknownName: there is none.
        """

    def require_type(self, stype: str, label: str) -> None:
        """Checks that a type exists; the label may be unknown.

        :raises UnknownName: no library has a skill of that type.
        """
