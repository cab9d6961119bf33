"""The errors shown in the error bar."""

from __future__ import annotations

import logging
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

from skiros2_common.core.errors import SkirosError

log = logging.getLogger(__name__)

#: The length of the history.
MAX_KEPT = 200


@dataclass(frozen=True)
class Problem:
    """:param activity: what failed, such as "loading the scene"; "" if the text says it.
    :param text: the error message.
    :param stamp: when it occurred last (s since the epoch).
    :param times: how often it has occurred in succession.
    """

    activity: str
    text: str
    stamp: float
    times: int = 1

    @property
    def line(self) -> str:
        """The whole message, as shown and copied."""
        times = f" ({self.times} times)" if self.times > 1 else ""
        return f"{self.activity}: {self.text}{times}" if self.activity else f"{self.text}{times}"


class Problems:
    """Collects errors. Used in the window's thread only."""

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._kept: deque[Problem] = deque(maxlen=MAX_KEPT)
        self._is_shown = False
        self._hooks: list[Callable[[], None]] = []

    def on_change(self, hook: Callable[[], None]) -> None:
        """Registers `hook`, which is called when a problem is added, and when the newest is dismissed."""
        self._hooks.append(hook)

    @property
    def newest(self) -> Problem | None:
        """The problem shown in the error bar; None if it was dismissed."""
        return self._kept[-1] if self._is_shown else None

    @property
    def history(self) -> list[Problem]:
        """The problems kept, the newest first."""
        return list(reversed(self._kept))

    def report(self, activity: str, error: Exception | SystemExit | str) -> None:
        """Adds a problem, or counts it if it equals the last one.

        :param activity: what failed, such as "loading the scene".
        """
        text = error_text(error)
        log.warning("%s: %s", activity, text) if activity else log.warning("%s", text)
        last = self._kept[-1] if self._kept else None
        if last is not None and (last.activity, last.text) == (activity, text):
            self._kept[-1] = Problem(activity, text, self._clock(), last.times + 1)
        else:
            self._kept.append(Problem(activity, text, self._clock()))
        self._is_shown = True
        self._changed()

    def dismiss(self) -> None:
        """Hides the newest problem; the history keeps it."""
        if self._is_shown:
            self._is_shown = False
            self._changed()

    def clear(self) -> None:
        """Discards all problems."""
        self._kept.clear()
        self._is_shown = False
        self._changed()

    def _changed(self) -> None:
        for hook in self._hooks:
            hook()


def error_text(error: BaseException | str) -> str:
    """Formats an error for users. Errors that are not `SkirosError` are prefixed with their type."""
    if isinstance(error, str):
        return error
    text = str(error).strip()
    if isinstance(error, SkirosError):
        return text or type(error).__name__
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


class ExceptHook:
    """Shows uncaught exceptions of the window's thread in the error bar, where PyQt would abort the program."""

    def __init__(self, problems: Problems) -> None:
        self._problems = problems
        self._before = sys.excepthook
        self._hook = self._on_error  # kept, as each access creates a new bound method
        sys.excepthook = self._hook

    def close(self) -> None:
        """Restores the previous hook, unless another one was installed since."""
        if sys.excepthook is self._hook:
            sys.excepthook = self._before

    def _on_error(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if not isinstance(error, Exception):
            self._before(kind, error, trace)
            return
        if self._before is sys.__excepthook__:
            log.error("uncaught exception in the window", exc_info=(kind, error, trace))
        else:
            self._before(kind, error, trace)
        self._problems.report("internal error of the window", error)
