"""Primitives whose work runs in a thread of its own."""

from __future__ import annotations

import threading

from skiros2_common.core.abstract_skill import State
from skiros2_common.core.errors import FOREIGN_ERRORS
from skiros2_common.core.primitive import PrimitiveBase
from skiros2_common.core.source_location import format_error


class PrimitiveThreadBase(PrimitiveBase):
    """A primitive that does its work in `run`, in a thread, so that a long call does not hold up the tree.

    The attribute `status` is the text that is reported while the thread runs.
    """

    def __init__(self) -> None:
        super().__init__()
        self.status = ""
        self._thread: threading.Thread | None = None
        self._outcome: tuple[State, str, int] | None = None
        self._running = threading.local()

    @property
    def _is_working(self) -> bool:
        return self._thread is not None and self._thread.is_alive()

    def preStart(self) -> bool:
        """To override: called before the thread starts. False fails the start."""
        return True

    def run(self) -> State:
        """To override: the work. Returns `success(...)` or `fail(...)`. Runs in the thread."""
        raise NotImplementedError(f"{self.__class__.__name__} has to define run")

    def onStart(self) -> bool:
        if self._is_working:
            return self.startError("the thread of an earlier start has not ended", -1)
        if self.preStart() is False:
            return False
        self._outcome = None
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

    # `success` and `fail` of `run` may not touch the progress while the tick thread reports it.

    def success(self, msg: str = "") -> State:
        if threading.current_thread() is self._thread:
            self._running.report = (msg, self._progress_code + 1)
            return State.Success
        return super().success(msg)

    def fail(self, msg: str, code: int) -> State:
        if threading.current_thread() is self._thread:
            self._running.report = (msg, -abs(code))
            return State.Failure
        return super().fail(msg, code)

    def _work(self) -> None:
        outcome = (State.Failure, f"{self._label}: the thread ended without an answer", -405)
        try:
            state = self.run()
            if state not in (State.Success, State.Failure):
                raise TypeError(f"{self._label}.run returned {state!r}, expected success(...) or fail(...)")
            message, code = getattr(self._running, "report", ("", 0))
            outcome = (state, message, code)
        except FOREIGN_ERRORS as error:
            outcome = (State.Failure, format_error(error, type(self).__module__), -405)
        finally:
            self._outcome = outcome
            self.wake()
