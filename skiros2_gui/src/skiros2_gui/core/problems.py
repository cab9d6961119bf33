"""What went wrong, for the error bar: in words, newest first, and no more than fits in a list."""

from __future__ import annotations

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from skiros2_common.core.errors import SkirosError

log = logging.getLogger(__name__)

#: So many are kept.
MOST_KEPT = 200


@dataclass(frozen=True)
class Problem:
    """
    :param what: what was being done, in words; "" where the text says it.
    :param text: what is wrong, for people.
    :param stamp: when it came up last (s since the epoch).
    :param times: how often it has come up one time after the other.
    """

    what: str
    text: str
    stamp: float
    times: int = 1

    @property
    def line(self) -> str:
        """All of it, as it is shown and copied."""
        times = f" ({self.times} times)" if self.times > 1 else ""
        return f"{self.what}: {self.text}{times}" if self.what else f"{self.text}{times}"


class Problems:
    """Collects problems. Used in the window's thread alone."""

    def __init__(self, clock: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._kept: deque[Problem] = deque(maxlen=MOST_KEPT)
        self._is_shown = False
        self._hooks: list[Callable[[], None]] = []

    def on_change(self, hook: Callable[[], None]) -> None:
        """`hook` is called when there is a new problem, and when the newest is not shown any more."""
        self._hooks.append(hook)

    @property
    def newest(self) -> Problem | None:
        """The one that the error bar shows; None when it was put away."""
        return self._kept[-1] if self._is_shown else None

    @property
    def history(self) -> list[Problem]:
        """Those that are kept, the newest first."""
        return list(reversed(self._kept))

    def tell(self, what: str, error: Exception | SystemExit | str) -> None:
        """Something went wrong.

        :param what: what was being done, in words, such as "loading the scene".
        """
        text = in_words(error)
        log.warning("%s: %s", what, text) if what else log.warning("%s", text)
        last = self._kept[-1] if self._kept else None
        if last is not None and (last.what, last.text) == (what, text):
            self._kept[-1] = Problem(what, text, self._clock(), last.times + 1)
        else:
            self._kept.append(Problem(what, text, self._clock()))
        self._is_shown = True
        self._changed()

    def put_away(self) -> None:
        """The newest has been read."""
        if self._is_shown:
            self._is_shown = False
            self._changed()

    def clear(self) -> None:
        """Nothing is kept."""
        self._kept.clear()
        self._is_shown = False
        self._changed()

    def _changed(self) -> None:
        for hook in self._hooks:
            hook()


def in_words(error: BaseException | str) -> str:
    """An error as people can read it: the platform's own are in plain words already, others are named."""
    if isinstance(error, str):
        return error
    text = str(error).strip()
    if isinstance(error, SkirosError):
        return text or type(error).__name__
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
