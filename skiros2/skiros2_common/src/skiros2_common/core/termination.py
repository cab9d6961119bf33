"""What asks a program to end, as an exception in its main thread, so that it can put away what it has started."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import Any

TERMINATION_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Terminated(KeyboardInterrupt):
    """A signal has asked the program to end.

    :ivar number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"ended by {signal.Signals(number).name}")
        self.number = number


class TerminationSignals:
    """A context manager, for the main thread: within it the first signal to end raises `Terminated`.

    Those that come after it are left out, and those that the program ignores (nohup) stay ignored.
    """

    def __init__(self) -> None:
        self._before: dict[int, Any] = {}
        self._came: int | None = None
        self._is_held = False

    def __enter__(self) -> TerminationSignals:
        """:raises ValueError: this is not the main thread."""
        for number in TERMINATION_SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                self._before[number] = signal.signal(number, self._end)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Within it no signal disturbs; one that came meanwhile is raised at the end."""
        self._is_held = True
        try:
            yield
        finally:
            self._is_held = False
        if self._came is not None:
            raise Terminated(self._came)

    def ignore(self) -> None:
        """From now on signals are left out: the program is ending."""
        self._is_held = True

    def _end(self, number: int, _: FrameType | None) -> None:
        if self._came is None:
            self._came = number
            if not self._is_held:
                raise Terminated(number)


def exit_status(interrupt: KeyboardInterrupt) -> int:
    """What a program ends with that a signal has ended, as shells have it."""
    return 128 + (interrupt.number if isinstance(interrupt, Terminated) else signal.SIGINT)
