"""A timeout for functions that cannot be interrupted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

from skiros2_common.core.errors import Refused, TimedOut

_Result = TypeVar("_Result")

#: The maximum number of abandoned calls that may still be running, to limit the processor load.
_MAX_ABANDONED = 2


class TimeLimit:
    """Runs functions in background threads and abandons those that take too long.

    An abandoned call runs on until it checks its event, or ends by itself. While too many are running, new calls are
    refused. Thread-safe.

    :param seconds: the timeout (s); 0: none.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._overdue: dict[Future[Any], str] = {}
        self._lock = threading.Lock()

    def run(self, work: Callable[[threading.Event], _Result], what: str) -> _Result:
        """Runs `work` and returns its result, or raises its exception.

        :param work: gets an event that is set when the call is abandoned.
        :param what: describes the work in error messages.
        :raises TimedOut: the work takes too long.
        :raises Refused: too many abandoned calls are still running.
        """
        with self._lock:
            if len(self._overdue) >= _MAX_ABANDONED:
                running = "; ".join(self._overdue.values())
                raise Refused(f"{what}: refused while abandoned calls are still running: {running}")
        future: Future[_Result] = Future()
        abandoned = threading.Event()
        done = threading.Lock()  # released at the end; ten times faster than waiting for the future
        done.acquire()

        def serve() -> None:
            try:
                future.set_result(work(abandoned))
            except Exception as error:
                # Drop the frames: their variables, such as answers of Oxigraph, may have to be freed in this thread.
                future.set_exception(error.with_traceback(None))
            with self._lock:
                self._overdue.pop(future, None)
            done.release()

        _in_a_thread(serve)
        if not done.acquire(timeout=self._seconds or -1):
            with self._lock:
                if not future.done():
                    self._overdue[future] = what
                    abandoned.set()
                    raise TimedOut(f"{what}: abandoned after {self._seconds:g} s")
        return future.result()


#: The inboxes of idle threads, which are reused: starting a thread takes longer than most work.
_idle: list[SimpleQueue[Callable[[], None]]] = []


def _in_a_thread(work: Callable[[], None]) -> None:
    try:
        inbox = _idle.pop()
    except IndexError:
        inbox = SimpleQueue()
        threading.Thread(target=_work, args=(inbox,), name="time-limit", daemon=True).start()
    inbox.put(work)


def _work(inbox: SimpleQueue[Callable[[], None]]) -> None:
    while True:
        inbox.get()()
        _idle.append(inbox)
