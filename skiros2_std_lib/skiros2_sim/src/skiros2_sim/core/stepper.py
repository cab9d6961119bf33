"""The thread that steps a simulated world, at a pace, and in which alone it is touched."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TypeVar

from skiros2_common.core.errors import Refused, WrongValue
from skiros2_sim.core.world import RATE, World

log = logging.getLogger(__name__)

T = TypeVar("T")

#: As much simulated time may be asked for in one go (steps): an hour.
MOST_STEPS = 3600 * RATE
#: Faster than that nobody can mean (x real time).
FASTEST = 1000.0

#: A world that is so far behind its pace goes on from there, rather than in a burst (s of wall time).
_MOST_BEHIND = 0.1


@dataclass
class _Owed:
    """Steps that somebody waits for while the world is paused."""

    left: int
    done: Future[None]


class Stepper:
    """Steps a world in a thread of its own. What others want of the world they `call`, or do in a hook.

    A step that fails stops the world, not the thread: `failure` says why, and a call `even_failed` may reset the world.

    :param world: belongs to this thread from `start` on.
    :param rate: how fast its time runs (times real time); 0: as fast as it can.
    :param paused: steps only when `step` asks for it.
    :raises WrongValue: the rate is none.
    """

    def __init__(self, world: World, rate: float = 1.0, paused: bool = False) -> None:
        self._world = world
        self._rate = checked_rate(rate)
        self._paused = paused
        self._ended = False
        self._failure = ""
        self._count = 0
        self._hooks: list[Callable[[], None]] = []
        self._failure_hooks: list[Callable[[str], None]] = []
        self._owed: list[_Owed] = []
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._lock = threading.Lock()  # of: ended
        self._thread = threading.Thread(target=self._run, name="stepper", daemon=True)
        self._slow_told = False
        self._anchor = (0.0, 0)  # of the pace: wall time, count

    # -- any thread ----------------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """Steps since the start; a reset of the world does not set it back."""
        return self._count

    @property
    def failure(self) -> str:
        """Why the world stands still; "" while it does not."""
        return self._failure

    @property
    def paused(self) -> bool:
        return self._paused

    def add_hook(self, hook: Callable[[], None], on_failure: Callable[[str], None] | None = None) -> None:
        """Before `start`: calls it after each step, in the thread that steps.

        :param on_failure: called once with the reason when a step has failed.
        """
        self._hooks.append(hook)
        if on_failure is not None:
            self._failure_hooks.append(on_failure)

    def start(self) -> None:
        """Steps from now on."""
        self._thread.start()

    def close(self, timeout: float = 5.0) -> None:
        """Ends the thread; calls that wait are refused.

        :param timeout: s to wait at most for what is being done.
        """
        with self._lock:
            self._ended = True
        self._calls.put(lambda: None)
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def call(self, function: Callable[[World], T], even_failed: bool = False) -> T:
        """Calls a function between two steps and returns what it returns. Waits for that; not for use in a hook.

        :param even_failed: also when a step has failed.
        :raises Refused: the world has ended, or a step has failed.

        It raises what the function raises.
        """
        result: Future[T] = Future()

        def serve() -> None:
            if self._ended:
                result.set_exception(Refused(_ENDED))
            elif self._failure and not even_failed:
                result.set_exception(Refused(self._failure))
            else:
                try:
                    result.set_result(function(self._world))
                except Exception as error:
                    result.set_exception(error)

        self._put(serve)
        return result.result()

    def step(self, steps: int) -> None:
        """Goes on by so many steps of a paused world, and waits until they are done.

        :raises WrongValue: so many cannot be meant.
        :raises Refused: it is not paused, or is resumed, fails or ends before.
        """
        if not 0 <= steps <= MOST_STEPS:
            raise WrongValue(f"{steps} steps: expected 0 to {MOST_STEPS}, an hour of simulated time")
        done: Future[None] = Future()

        def owe(_: World) -> None:
            if not self._paused:
                raise Refused("the world is not paused: it steps by itself")
            self._owed.append(_Owed(steps, done))

        self.call(owe)
        done.result()

    def pause(self, paused: bool) -> None:
        """Stops time, or lets it go on."""

        def change(_: World) -> None:
            self._paused = paused
            if not paused:
                self._give_up("the world was resumed while it was stepped")
            self._restart_pace()

        self.call(change, even_failed=True)

    def set_rate(self, rate: float) -> None:
        """How fast time runs: times real time; 0: as fast as it can.

        :raises WrongValue: it is no number of 0 or more.
        """
        checked = checked_rate(rate)

        def change(_: World) -> None:
            self._rate = checked
            self._slow_told = False
            self._restart_pace()

        self.call(change, even_failed=True)

    def mend(self) -> None:
        """In a call that has put the world back to its start: goes on, also after a step that failed.

        It counts as a step, so that what was and what is now have different times.
        """
        self._failure = ""
        self._count += 1
        self._restart_pace()

    # -- the thread ----------------------------------------------------------------------------------------------

    def _put(self, serve: Callable[[], None]) -> None:
        with self._lock:
            if self._ended:
                raise Refused(_ENDED)
            self._calls.put(serve)

    def _run(self) -> None:
        self._restart_pace()
        while not self._ended:
            self._serve(self._wait())
            if not self._ended and self._is_due():
                self._step()
        self._give_up(_ENDED)
        while not self._calls.empty():
            self._calls.get()()

    def _serve(self, timeout: float | None) -> None:
        """Does what was asked for; waits for that no longer than `timeout` (s)."""
        try:
            self._calls.get(timeout=timeout)() if timeout != 0.0 else self._calls.get_nowait()()
        except queue.Empty:
            return
        while not self._calls.empty():
            self._calls.get()()

    def _wait(self) -> float | None:
        """How long until the next step (s); None: until somebody asks for it."""
        if self._failure or (self._paused and not self._owed):
            return None
        if self._paused or not self._rate:
            return 0.0
        return max(0.0, self._due() - time.monotonic())

    def _is_due(self) -> bool:
        if self._failure:
            return False
        if self._paused:
            return bool(self._owed)
        return not self._rate or time.monotonic() >= self._due()

    def _due(self) -> float:
        began, count = self._anchor
        return began + (self._count + 1 - count) / (RATE * self._rate)

    def _step(self) -> None:
        if self._owed and not self._owed[0].left:
            self._owed.pop(0).done.set_result(None)
            return
        try:
            self._world.step()
        except Exception as error:
            log.exception("step %d of the simulated world", self._world.steps)
            self._fail(f"the simulated world stands still since a step failed, reset it: {_named(error)}")
            return
        self._count += 1
        for hook in self._hooks:
            try:
                hook()
            except Exception as error:
                log.exception("after step %d of the simulated world", self._world.steps)
                self._fail(f"the simulated world stands still since it could not be told of, reset it: {_named(error)}")
                return
        if self._owed:
            self._owed[0].left -= 1
            if not self._owed[0].left:
                self._owed.pop(0).done.set_result(None)
        elif self._rate:
            self._keep_pace()

    def _keep_pace(self) -> None:
        behind = time.monotonic() - self._due()
        if behind < _MOST_BEHIND:
            return
        began, count = self._anchor
        if not self._slow_told:
            self._slow_told = True
            reached = (self._count - count) / RATE / max(time.monotonic() - began, 1e-9)
            log.warning("the simulated world cannot keep up with %g x real time (%.2g x at last)", self._rate, reached)
        self._restart_pace()

    def _restart_pace(self) -> None:
        self._anchor = time.monotonic(), self._count

    def _fail(self, reason: str) -> None:
        self._failure = reason
        self._give_up(reason)
        for hook in self._failure_hooks:
            try:
                hook(reason)
            except Exception:
                log.exception("telling that the simulated world stands still")

    def _give_up(self, reason: str) -> None:
        owed, self._owed = self._owed, []
        for entry in owed:
            entry.done.set_exception(Refused(reason))


_ENDED = "the simulated world has ended"


def _named(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def checked_rate(rate: float) -> float:
    """
    :raises WrongValue: it is no number of 0 to `FASTEST`.
    """
    if not 0 <= rate <= FASTEST:
        raise WrongValue(f"a rate of {rate}: expected times real time up to {FASTEST:g}, or 0: as fast as it can")
    return float(rate)
