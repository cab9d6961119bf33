"""Coordination of programs: atomic requests, optimistic locking, waiting for changes, the advisory lock."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Apply, Expect, Operation, Outcome
from skiros2_world_model.core.changeset import ChangeSet
from skiros2_world_model.core.history import HistoryEntry, Point
from skiros2_world_model.core.last_will import CleanupAction
from skiros2_world_model.core.world_model_abstract_interface import WmException

#: How often a wait checks its condition without a change (s): for computed relations, and for the node's shutdown.
_CHECK_PERIOD = 0.5


class Coordination(ABC):
    """The calls of the world model port for coordination between programs. Thread-safe."""

    @property
    @abstractmethod
    def author(self) -> str:
        """The author of this client's changes."""

    @abstractmethod
    def add_listener(self, callback: Callable[[Any], None]) -> None:
        """Calls `callback(change)` after each change that this client sees, in order. It must return quickly."""

    @abstractmethod
    def remove_listener(self, callback: Callable[[Any], None]) -> None:
        """Removes a listener."""

    @abstractmethod
    def check_relation(self, subj: Any, pred: str, obj: Any, state: bool, abstract: bool) -> bool:
        """Whether a relation holds."""

    @abstractmethod
    def history(self, eid: str = "", *, until: Point | None = None, limit: int = 0) -> list[HistoryEntry]:
        """The journal's entries about an element."""

    @abstractmethod
    def set_last_will(self, actions: Sequence[CleanupAction]) -> None:
        """Sets the cleanup actions that the world model runs when the node of this process dies.

        They replace the node's previous last will. The last will of an earlier process of this node is run first.

        :param actions: the cleanup actions; none withdraws the last will.
        :raises WmException: the world model refuses, or does not answer.
        """

    @abstractmethod
    def _transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        """Applies operations, all or none."""

    @abstractmethod
    def _write(self, elements: Sequence[Element], context_id: str, before: Sequence[Operation]) -> list[str]:
        """Writes elements as `update_elements` does, after other operations of the same request."""

    # -- requests and optimistic locking -----------------------------------------------------------------------

    def transact(self, operations: Sequence[Operation], context_id: str = "scene") -> Outcome:
        """Applies operations (`skiros2_world_model.core.changes`) as one request, all or none.

        :raises WmConflict: an element of an `Expect` has changed since it was read; the request changed nothing.
        :raises WmException: an operation is refused; the request changed nothing.
        """
        return self._transact(operations, context_id)

    def update_elements_if_unchanged(self, es: Sequence[Element], context_id: str = "scene") -> list[str]:
        """Writes elements as `update_elements` does, unless one of them has changed since it was read.

        :raises WmConflict: an element has changed; the text names the author and the time. Nothing was written.
        :raises WmException: an element was not read from the world model, or is refused. Nothing was written.
        """
        made_by_hand = [e for e in es if e.version < 0]
        if made_by_hand:
            raise WmException(f"{made_by_hand[0]!r} was not read from the world model, so it has no version to compare")
        return self._write(es, context_id, [Expect(e.id, e.version) for e in es])

    def update_element_if_unchanged(self, e: Element, context_id: str = "scene") -> str:
        """Writes an element and returns its id; see `update_elements_if_unchanged`."""
        return self.update_elements_if_unchanged([e], context_id)[0]

    def revert(self, change: HistoryEntry | ChangeSet, context_id: str = "scene") -> Outcome:
        """Undoes a change, such as an entry of `history`, in one request. Later changes of other parts stay.

        :raises WmConflict: parts of it have changed since; the text has all of them, with their authors. Nothing has
            changed.
        :raises WmException: the world model refuses the request, or does not answer.
        """
        change_set = change.changes if isinstance(change, HistoryEntry) else change
        return self._transact([Apply(change_set.inverse())], context_id)

    def last_change(self, eid: str) -> HistoryEntry:
        """The last change of an element, with its time (`stamp`) and its `author`.

        :raises WmException: the element does not exist, or the world model has no journal.
        """
        return self.history(eid, limit=1)[-1]

    # -- waiting -----------------------------------------------------------------------------------------------

    def wait_until(self, check: Callable[[], bool], timeout: float | None = None) -> bool:
        """Blocks until `check()` is true. It is evaluated after each change of the scene.

        :param check: reads this world model; called in the waiting thread.
        :param timeout: in s; None: no limit.
        :returns: False at the timeout, or when the node shuts down.
        """
        if timeout is not None and timeout != timeout:
            raise WrongValue("the timeout is not a number")
        deadline = None if timeout is None else time.monotonic() + timeout
        changed = threading.Event()

        def listener(_: Any) -> None:
            changed.set()

        self.add_listener(listener)
        try:
            while not check():
                remaining = _CHECK_PERIOD if deadline is None else min(_CHECK_PERIOD, deadline - time.monotonic())
                if remaining <= 0 or self._is_shut_down():
                    return False
                changed.wait(remaining)
                changed.clear()
            return True
        finally:
            self.remove_listener(listener)

    def wait_for_relation(
        self, subj: Any, pred: str, obj: Any, state: bool = True, timeout: float | None = None
    ) -> bool:
        """Blocks until a relation holds (`state` true) or does not hold; arguments as for `check_relation`.

        :param timeout: in s; None: no limit.
        :returns: False at the timeout, or when the node shuts down.
        """
        return self.wait_until(lambda: self.check_relation(subj, pred, obj, state, False), timeout)

    def _is_shut_down(self) -> bool:
        """Whether the node is shutting down."""
        return False


class AdvisoryLock:
    """A lock with one owner, which any client may release. Thread-safe."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self.owner: str | None = None

    def acquire(self, owner: str, timeout: float | None = None) -> bool:
        """Blocks until the lock is free and acquires it. Returns False at the timeout.

        :param owner: the name of the new owner.
        :param timeout: in s; None: no limit.
        """
        with self._free:
            if not self._free.wait_for(lambda: self.owner is None, timeout):
                return False
            self.owner = owner
            return True

    def release(self, owner: str | None = None) -> bool:
        """Releases the lock. Returns False when it is free, or held by another owner than `owner` (None: any)."""
        with self._free:
            if self.owner is None or owner not in (None, self.owner):
                return False
            self.owner = None
            self._free.notify()
            return True
