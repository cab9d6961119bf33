"""Acting together: requests of several changes, changes that depend on what was read, waiting for others."""

from __future__ import annotations

import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.world_element import Element
from skiros2_world_model.core.changes import Expect, Operation, Outcome
from skiros2_world_model.core.history_entry import HistoryEntry
from skiros2_world_model.core.wills import Bequest
from skiros2_world_model.core.world_model_abstract_interface import WmException

#: How often a wait looks again without a change (s): for relations that reasoners compute, and for the node's end.
_LOOK_AGAIN = 0.5


class Coordination(ABC):
    """What programs that share a world model use beside reading and writing. Safe to use from all threads."""

    @property
    @abstractmethod
    def author(self) -> str:
        """Who makes the changes, as the world model names it."""

    @abstractmethod
    def add_listener(self, callback: Callable[[Any], None]) -> None:
        """`callback(change)` is called after each change seen from here, in order; it must be quick."""

    @abstractmethod
    def remove_listener(self, callback: Callable[[Any], None]) -> None:
        """The callback is called no more."""

    @abstractmethod
    def check_relation(self, subj: Any, pred: str, obj: Any, state: bool, abstract: bool) -> bool:
        """Whether a relation holds, as the world model's clients define it."""

    @abstractmethod
    def history(self, eid: str = "", *, limit: int = 0) -> list[HistoryEntry]:
        """What the journal tells of the changes of an element."""

    @abstractmethod
    def leave_will(self, bequests: Sequence[Bequest]) -> None:
        """Leaves what is to become of elements when the node of this process is gone without having taken it back.

        It takes the place of what the node has left before, also of an earlier life of it, which is carried out then.

        :param bequests: what becomes of which elements; none takes back what was left.
        :raises WmException: the world model refuses, or does not answer.
        """

    @abstractmethod
    def _transact(self, operations: Sequence[Operation], context: str) -> Outcome:
        """Applies operations, all or none."""

    @abstractmethod
    def _write(self, elements: Sequence[Element], context_id: str, before: Sequence[Operation]) -> list[str]:
        """Writes elements as `update_elements`, in one request with some operations before."""

    # -- several changes, and changes that depend on what was read ---------------------------------------------

    def transact(self, operations: Sequence[Operation], context_id: str = "scene") -> Outcome:
        """Applies some operations (`skiros2_world_model.core.changes`) as one request: all of them or none.

        :raises WmConflict: an element that an `Expect` names was changed after it was read; nothing has changed.
        :raises WmException: something is refused; nothing has changed.
        """
        return self._transact(operations, context_id)

    def update_elements_if_unchanged(self, es: Sequence[Element], context_id: str = "scene") -> list[str]:
        """Writes elements as `update_elements`, if none of them was changed by anybody since it was read.

        :raises WmConflict: one was; the text tells by whom and when. Nothing has changed.
        :raises WmException: one was not read from the world model, or is refused; nothing has changed.
        """
        made_by_hand = [e for e in es if e.version < 0]
        if made_by_hand:
            raise WmException(f"{made_by_hand[0]!r} was not read from the world model: nothing to compare it with")
        return self._write(es, context_id, [Expect(e.id, e.version) for e in es])

    def update_element_if_unchanged(self, e: Element, context_id: str = "scene") -> str:
        """Writes an element, as `update_elements_if_unchanged`; returns its id."""
        return self.update_elements_if_unchanged([e], context_id)[0]

    def last_change(self, eid: str) -> HistoryEntry:
        """The last change of an element: when it was (`stamp`), who made it (`author`), what it was.

        :raises WmException: there is no such element, or the world model keeps no journal.
        """
        return self.history(eid, limit=1)[-1]

    # -- waiting -----------------------------------------------------------------------------------------------

    def wait_until(self, check: Callable[[], bool], timeout: float | None = None) -> bool:
        """Waits until `check()` is true, which is asked again whenever the scene has changed.

        :param check: called in the waiting thread; reads this world model.
        :param timeout: s at most; None: as long as it takes.
        :returns: False when the time is over or the node ends.
        """
        if timeout is not None and timeout != timeout:
            raise WrongValue("the timeout is not a number")
        end = None if timeout is None else time.monotonic() + timeout
        changed = threading.Event()

        def listener(_: Any) -> None:
            changed.set()

        self.add_listener(listener)
        try:
            while not check():
                left = _LOOK_AGAIN if end is None else min(_LOOK_AGAIN, end - time.monotonic())
                if left <= 0 or self._is_over():
                    return False
                changed.wait(left)
                changed.clear()
            return True
        finally:
            self.remove_listener(listener)

    def wait_for_relation(
        self, subj: Any, pred: str, obj: Any, state: bool = True, timeout: float | None = None
    ) -> bool:
        """Waits until a relation, or one under it, holds (`state` true) or does not; arguments as `check_relation`.

        :param timeout: s at most; None: as long as it takes.
        :returns: False when the time is over or the node ends.
        """
        return self.wait_until(lambda: self.check_relation(subj, pred, obj, state, False), timeout)

    def _is_over(self) -> bool:
        """Whether waiting is in vain, as the process ends."""
        return False
