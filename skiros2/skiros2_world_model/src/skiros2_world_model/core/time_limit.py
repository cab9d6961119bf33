"""Work that may take too long, and cannot be ended from outside."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

from skiros2_common.core.errors import Refused, TimedOut

_Result = TypeVar("_Result")

#: So much that was given up may still be running; more would take all the processor's time.
_MOST_OVERDUE = 2


class TimeLimit:
    """Runs work in threads of its own, and gives up what takes too long.

    Work that was given up goes on until it looks whether it was, or ends by itself. While too much of it does, no other
    is begun. Safe to use from all threads.

    :param seconds: how long work may take; 0: as long as it likes.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._overdue: dict[Future[Any], str] = {}
        self._lock = threading.Lock()

    def run(self, work: Callable[[threading.Event], _Result], what: str) -> _Result:
        """What the work returns; or it raises what the work raises.

        :param work: is given the event that tells it that nobody waits for it any more.
        :raises TimedOut: it takes too long.
        :raises Refused: too much that was given up is still running.
        """
        with self._lock:
            if len(self._overdue) >= _MOST_OVERDUE:
                running = "; ".join(self._overdue.values())
                raise Refused(f"{what}: not begun, as what was given up is still running: {running}")
        future: Future[_Result] = Future()
        abandoned = threading.Event()
        done = threading.Lock()  # held until it is; in a tenth of the time that waiting for the future takes
        done.acquire()

        def serve() -> None:
            try:
                future.set_result(work(abandoned))
            except Exception as error:
                # Without the frames, whose variables may have to go in this thread, as answers of Oxigraph do.
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
                    raise TimedOut(f"{what}: given up after {self._seconds:g} s")
        return future.result()


#: Where threads that have nothing to do wait for work. To start one takes longer than most work does.
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
