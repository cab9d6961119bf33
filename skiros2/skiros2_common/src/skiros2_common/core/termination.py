"""Termination signals as an exception in the main thread, so that a program can clean up."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType, TracebackType
from typing import Any

TERMINATION_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Terminated(KeyboardInterrupt):
    """The program received a termination signal.

    :ivar number: the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"terminated by {signal.Signals(number).name}")
        self.number = number


class TerminationSignals:
    """A context manager for the main thread: the first termination signal raises `Terminated`.

    Later signals, and signals that the program already ignores (nohup), are ignored.
    """

    def __init__(self) -> None:
        self._handlers: dict[int, Any] = {}
        self._received: int | None = None
        self._is_deferred = False

    def __enter__(self) -> TerminationSignals:
        """:raises ValueError: this is not the main thread."""
        for number in TERMINATION_SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:
                self._handlers[number] = signal.signal(number, self._end)
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)

    @contextlib.contextmanager
    def deferred(self) -> Iterator[None]:
        """A context manager that defers signals: one received inside is raised at its end."""
        self._is_deferred = True
        try:
            yield
        finally:
            self._is_deferred = False
        if self._received is not None:
            raise Terminated(self._received)

    def ignore(self) -> None:
        """Ignores further signals, because the program is ending."""
        self._is_deferred = True

    def _end(self, number: int, _: FrameType | None) -> None:
        if self._received is None:
            self._received = number
            if not self._is_deferred:
                raise Terminated(number)


def exit_status(interrupt: KeyboardInterrupt) -> int:
    """The exit status of a program that a signal ended, by the convention of shells."""
    return 128 + (interrupt.number if isinstance(interrupt, Terminated) else signal.SIGINT)
