"""Mistakes of the window's own code are shown, instead of ending the program as PyQt does by itself."""

from __future__ import annotations

import logging
import sys
from types import TracebackType

from skiros2_gui.core.problems import Problems

log = logging.getLogger(__name__)


class Mishaps:
    """From now on, what nobody has caught in the window's thread goes to the error bar; until `close`."""

    def __init__(self, problems: Problems) -> None:
        self._problems = problems
        self._before = sys.excepthook
        self._hook = self._on_error  # one object: bound methods are made anew each time
        sys.excepthook = self._hook

    def close(self) -> None:
        """What was before is so again, unless somebody else has come in between."""
        if sys.excepthook is self._hook:
            sys.excepthook = self._before

    def _on_error(self, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if not isinstance(error, Exception):
            self._before(kind, error, trace)
            return
        if self._before is sys.__excepthook__:
            log.error("a mistake of the window", exc_info=(kind, error, trace))
        else:
            self._before(kind, error, trace)
        self._problems.tell("a mistake of the window itself", error)
