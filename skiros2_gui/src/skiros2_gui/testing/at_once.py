"""Jobs that are carried out where they are asked for, for tests of presenters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from skiros2_gui.core.inbox import Inbox
from skiros2_gui.core.jobs import Jobs
from skiros2_gui.core.problems import Problems
from skiros2_gui.core.system import System
from skiros2_gui.core.window import Window

Result = TypeVar("Result")


class AtOnce(Jobs):
    """Jobs that have ended, and whose results were handed out, when `run` returns.

    :param held: they wait for `release` instead, to see what is shown meanwhile.
    """

    def __init__(self, problems: Problems, held: bool = False) -> None:
        super().__init__(problems, lambda: None)
        self.held = held
        self._waiting: list[Callable[[], None]] = []

    def run(
        self,
        call: Callable[[], Result],
        done: Callable[[Result], None] | None = None,
        failed: Callable[[Exception], None] | None = None,
        *,
        what: str = "",
        lane: str = "",
        urgent: bool = False,
    ) -> None:
        if self.held:
            self._waiting.append(lambda: self._now(call, done, failed, what))
        else:
            self._now(call, done, failed, what)

    def post(self, call: Callable[[], None]) -> None:
        call()

    def release(self) -> None:
        """Carries out what waits."""
        waiting, self._waiting = self._waiting, []
        for job in waiting:
            job()

    def _now(
        self,
        call: Callable[[], Result],
        done: Callable[[Result], None] | None,
        failed: Callable[[Exception], None] | None,
        what: str,
    ) -> None:
        try:
            result = call()
        except Exception as error:
            if failed is None:
                self._problems.tell(what, error)
            else:
                failed(error)
            return
        if done is not None:
            done(result)


def make_window(connect: Callable[[Inbox], System]) -> Window:
    """A window of presenters alone. What the system tells is taken by `take_news`."""
    problems = Problems()
    inbox = Inbox(lambda: None)
    return Window(connect(inbox), AtOnce(problems), problems, inbox)
