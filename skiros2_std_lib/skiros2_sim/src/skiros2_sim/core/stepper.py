"""The thread that steps a simulated world at a given rate; only this thread accesses the world."""

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
from skiros2_sim.core.world import World

log = logging.getLogger(__name__)

T = TypeVar("T")

#: Maximum simulated time of a request for steps (s).
MAX_TIME = 3600
#: Maximum rate (times real time).
MAX_RATE = 1000.0

#: Period of the idle hooks (s of wall time).
IDLE_PERIOD = 0.5

#: With a larger delay (s of wall time), the schedule restarts, instead of catching up in a burst.
_MAX_DELAY = 0.1


@dataclass
class _StepRequest:
    """A client's request for steps of a paused world."""

    remaining: int
    done: Future[None]


class Stepper:
    """Steps a world in its own thread. Other threads access the world by `call`, or by a hook.

    A failed step stops the world, not the thread: `failure` is the reason, and a call `even_failed` may reset the
    world.

    :param world: used only by this thread after `start`.
    :param rate: speed of simulated time (times real time); 0 for the maximum.
    :param paused: whether to step only on request.
    :raises WrongValue: the rate is invalid.
    """

    def __init__(self, world: World, rate: float = 1.0, paused: bool = False) -> None:
        self._world = world
        #: Steps per second of simulated time.
        self.step_rate = world.rate
        self._rate = checked_rate(rate)
        self._paused = paused
        self._ended = False
        self._failure = ""
        self._count = 0
        self._hooks: list[Callable[[], None]] = []
        self._failure_hooks: list[Callable[[str], None]] = []
        self._idle_hooks: list[Callable[[], None]] = []
        self._idle_at = 0.0
        self._requests: list[_StepRequest] = []
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._lock = threading.Lock()  # of: ended
        self._thread = threading.Thread(target=self._run, name="stepper", daemon=True)
        self._slow_logged = False
        self._anchor = (0.0, 0)  # of the pace: wall time, count

    # -- any thread ----------------------------------------------------------------------------------------------

    @property
    def count(self) -> int:
        """Steps since the start; not reset with the world."""
        return self._count

    @property
    def failure(self) -> str:
        """Why the world has stopped; "" if it has not."""
        return self._failure

    @property
    def paused(self) -> bool:
        return self._paused

    def add_hook(self, hook: Callable[[], None], on_failure: Callable[[str], None] | None = None) -> None:
        """Adds a function to call after each step, in the stepping thread. Call before `start`.

        :param on_failure: called once with the reason after a failed step.
        """
        self._hooks.append(hook)
        if on_failure is not None:
            self._failure_hooks.append(on_failure)

    def add_idle_hook(self, hook: Callable[[], None]) -> None:
        """Adds a function to call in the stepping thread each `IDLE_PERIOD` while the world is paused: it shows that
        the world is not dead. Call before `start`."""
        self._idle_hooks.append(hook)

    def start(self) -> None:
        """Starts stepping."""
        self._thread.start()

    def close(self, timeout: float = 5.0) -> None:
        """Stops the thread; waiting calls raise `Refused`.

        :param timeout: maximum time to wait for the current step (s).
        """
        with self._lock:
            self._ended = True
        self._calls.put(lambda: None)
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(timeout)

    def call(self, function: Callable[[World], T], even_failed: bool = False) -> T:
        """Calls a function between two steps and returns its result. Blocks; must not be called in a hook.

        :param even_failed: whether to call it after a failed step too.
        :raises Refused: the world has ended, or a step has failed.

        Exceptions of the function propagate.
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
        """Makes steps of a paused world, and waits for their end.

        :raises WrongValue: the number is out of range.
        :raises Refused: the world is not paused, or is resumed, fails or ends meanwhile.
        """
        most = MAX_TIME * self.step_rate
        if not 0 <= steps <= most:
            raise WrongValue(f"{steps} steps: expected 0 to {most}, an hour of simulated time")
        done: Future[None] = Future()

        def request(_: World) -> None:
            if not self._paused:
                raise Refused("the world is not paused: it steps on its own")
            self._requests.append(_StepRequest(steps, done))

        self.call(request)
        done.result()

    def pause(self, paused: bool) -> None:
        """Pauses or resumes simulated time."""

        def change(_: World) -> None:
            self._paused = paused
            if not paused:
                self._fail_requests("the world was resumed while it was stepped")
            self._restart_timing()

        self.call(change, even_failed=True)

    def set_rate(self, rate: float) -> None:
        """Sets the speed of simulated time (times real time); 0 for the maximum.

        :raises WrongValue: the rate is negative or not a number.
        """
        checked = checked_rate(rate)

        def change(_: World) -> None:
            self._rate = checked
            self._slow_logged = False
            self._restart_timing()

        self.call(change, even_failed=True)

    def recover(self) -> None:
        """Resumes after a reset of the world, also after a failed step. Call in the stepping thread.

        Counts as a step, so that states before and after the reset have different times.
        """
        self._failure = ""
        self._count += 1
        self._restart_timing()

    # -- the thread ----------------------------------------------------------------------------------------------

    def _put(self, serve: Callable[[], None]) -> None:
        with self._lock:
            if self._ended:
                raise Refused(_ENDED)
            self._calls.put(serve)

    def _run(self) -> None:
        self._restart_timing()
        while not self._ended:
            self._process_calls(self._wait())
            if not self._ended and self._is_due():
                self._step()
            elif self._paused and not (self._ended or self._failure):
                self._idle()
        self._fail_requests(_ENDED)
        while not self._calls.empty():
            self._calls.get()()

    def _process_calls(self, timeout: float | None) -> None:
        """Executes waiting calls; waits at most `timeout` seconds for one."""
        try:
            self._calls.get(timeout=timeout)() if timeout != 0.0 else self._calls.get_nowait()()
        except queue.Empty:
            return
        while not self._calls.empty():
            self._calls.get()()

    def _wait(self) -> float | None:
        """Returns the time until the next step (s), or until the idle hooks; None if there is nothing to wait for."""
        if self._failure or (self._paused and not self._requests):
            return IDLE_PERIOD if self._idle_hooks and not self._failure else None
        if self._paused or not self._rate:
            return 0.0
        return max(0.0, self._due() - time.monotonic())

    def _is_due(self) -> bool:
        if self._failure:
            return False
        if self._paused:
            return bool(self._requests)
        return not self._rate or time.monotonic() >= self._due()

    def _due(self) -> float:
        began, count = self._anchor
        return began + (self._count + 1 - count) / (self.step_rate * self._rate)

    def _step(self) -> None:
        if self._requests and not self._requests[0].remaining:
            self._requests.pop(0).done.set_result(None)
            return
        try:
            self._world.step()
        except Exception as error:
            log.exception("step %d of the simulated world", self._world.steps)
            self._fail(f"the simulation has stopped because a step failed; reset it: {_error_text(error)}")
            return
        self._count += 1
        for hook in self._hooks:
            try:
                hook()
            except Exception as error:
                log.exception("after step %d of the simulated world", self._world.steps)
                reason = "publishing its state failed"
                self._fail(f"the simulation has stopped because {reason}; reset it: {_error_text(error)}")
                return
        if self._requests:
            self._requests[0].remaining -= 1
            if not self._requests[0].remaining:
                self._requests.pop(0).done.set_result(None)
        elif self._rate:
            self._check_delay()

    def _idle(self) -> None:
        if time.monotonic() < self._idle_at:
            return
        self._idle_at = time.monotonic() + IDLE_PERIOD
        for hook in self._idle_hooks:
            try:
                hook()
            except Exception:
                log.exception("publishing the state of the paused world")

    def _check_delay(self) -> None:
        behind = time.monotonic() - self._due()
        if behind < _MAX_DELAY:
            return
        began, count = self._anchor
        if not self._slow_logged:
            self._slow_logged = True
            reached = (self._count - count) / self.step_rate / max(time.monotonic() - began, 1e-9)
            log.warning("the simulated world cannot keep up with %g x real time (last: %.2g x)", self._rate, reached)
        self._restart_timing()

    def _restart_timing(self) -> None:
        self._anchor = time.monotonic(), self._count

    def _fail(self, reason: str) -> None:
        self._failure = reason
        self._fail_requests(reason)
        for hook in self._failure_hooks:
            try:
                hook(reason)
            except Exception:
                log.exception("reporting a failure of the simulated world")

    def _fail_requests(self, reason: str) -> None:
        owed, self._requests = self._requests, []
        for entry in owed:
            entry.done.set_exception(Refused(reason))


_ENDED = "the simulated world has ended"


def _error_text(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def checked_rate(rate: float) -> float:
    """Checks a rate.

    :raises WrongValue: it is not a number from 0 to `MAX_RATE`.
    """
    if not 0 <= rate <= MAX_RATE:
        raise WrongValue(f"rate {rate}: expected up to {MAX_RATE:g} times real time, or 0 for the maximum")
    return float(rate)
