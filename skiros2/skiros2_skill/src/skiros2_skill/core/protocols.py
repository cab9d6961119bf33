"""Protocols between the parts: the tree, the engine and the library.

The world model is `WorldModelPort` in `skiros2_common`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

from skiros2_common.core.abstract_skill import SkillCore, State
from skiros2_common.core.world_model_port import WorldModelPort

if TYPE_CHECKING:
    from skiros2_skill.core.tree.hook_guard import HookGuard
    from skiros2_skill.core.tree.node import SkillInterface
    from skiros2_skill.core.tree.skill_node import SkillWrapper


class TreeNode(Protocol):
    """A node as a processor sees it."""

    @property
    def state(self) -> State: ...
    def visit(self, visitor: Visitor) -> State:
        """Ticks the node once. Returns its state."""

    def visitPreempt(self, visitor: Visitor) -> State:
        """Preempts the node. Returns its state, Running while it is still ending."""


class Freshness(Protocol):
    """Whether the parameters of a task are up to date."""

    @property
    def world_changed(self) -> bool:
        """Whether the world model has changed and the nodes that read it are not marked yet."""

    @property
    def local_revision(self) -> int:
        """The revision of the process when it was last compared."""


class Visitor(Protocol):
    """The visitor that ticks a tree: the executor of a task."""

    changed: bool

    @property
    def parameters(self) -> Freshness: ...
    @property
    def guard(self) -> HookGuard: ...
    def execute(self, node: SkillInterface) -> State:
        """Ticks a group."""

    def execute_skill(self, node: SkillWrapper) -> State:
        """Ticks a skill."""

    def finish_execute(self, node: SkillWrapper, answer: object, error: Exception | SystemExit | None = None) -> State:
        """Handles what the `execute` of a primitive has returned or raised. Returns the state."""

    def preempt(self, node: SkillInterface) -> State:
        """Preempts a node, leaves first."""

    def set_state(self, node: SkillInterface, state: State) -> None:
        """Sets the state of a node."""


class ImplementationPort(Protocol):
    """A class that implements a skill."""

    @property
    def label(self) -> str: ...
    @property
    def declared(self) -> Any:
        """An instance that never runs; it has the description."""

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
