"""Primitives that work in a separate thread."""

from __future__ import annotations

import threading

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.failure_kind import FailureKind
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import format_error


class PrimitiveThreadBase(PrimitiveBase):
    """A primitive that calls `run` in a thread, so that a long call does not block the tree.

    While the thread runs, the attribute `status` is its progress message.
    """

    def __init__(self) -> None:
        super().__init__()
        self.status = ""
        self._thread: threading.Thread | None = None
        self._outcome: tuple[State, str, int] | None = None
        self._report = ("", 0)

    @property
    def works_in_background(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def preStart(self) -> bool:
        """To override: called before the thread starts. Return False to fail the start."""
        return True

    def run(self) -> State:
        """To override: the work, called in the thread. Returns `success(...)` or `fail(...)`."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define run")

    def onStart(self) -> bool:
        if self.works_in_background:
            return self.startError("the thread of an earlier start is still running", -1)
        if self.preStart() is False:
            return False
        self._outcome, self._report = None, ("", 0)
        self._thread = threading.Thread(target=self._work, name=f"{self._label}.run", daemon=True)
        self._thread.start()
        return True

    def execute(self) -> State:
        assert self._thread is not None
        if self._outcome is None:
            return self.step(self.status)
        self._thread.join()
        state, message, code = self._outcome
        self._setProgress(message, code)
        return state

    # `success` and `fail` in `run` must not write the progress while the tick thread reads it.

    def success(self, msg: str = "") -> State:
        if threading.current_thread() is self._thread:
            self._report = (msg, self._progress_code + 1)
            return State.Success
        return super().success(msg)

    def fail(self, msg: str, code: int, kind: FailureKind = FailureKind.RETRYABLE) -> State:
        if threading.current_thread() is self._thread:
            self._report, self.failure_kind = (msg, -abs(code)), self.failure_kind.worst(kind)
            return State.Failure
        return super().fail(msg, code, kind)

    def _work(self) -> None:
        outcome = (State.Failure, f"{self._label}: the thread ended without a result", -405)
        try:
            state = self.run()
            if state not in (State.Success, State.Failure):
                raise TypeError(f"{self._label}.run returned {state!r}, expected success(...) or fail(...)")
            outcome = (state, *self._report)
        except FOREIGN_ERRORS as error:
            outcome = (State.Failure, format_error(error, type(self).__module__), -405)
        finally:
            self._outcome = outcome
            self.wake()
