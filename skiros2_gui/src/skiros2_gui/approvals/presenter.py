"""What agents ask for, and the answers of the person who has logged in."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from skiros2_common.core.errors import SkirosError
from skiros2_common.core.wording import visible
from skiros2_gui.app.names import Names
from skiros2_gui.app.window import Window
from skiros2_gui.approvals.gateway import Gateway, LoggedOut
from skiros2_task.core.goal_sentence import goal_sentence

#: The roles that may answer. The gateway also checks that the account is a person's.
_ROLES = ("approve", "maintain")
_QUEUE = "gateway"


class ApprovalsPresenter:
    """Asks the gateway by jobs of the window.

    :param changed: called after each change.
    :param connect: makes a session at an address.
    :ivar address: of the gateway; "": none has been found.
    :ivar user, role: of the session; "": nobody has logged in.
    :ivar waiting: the requests, the oldest first.
    :ivar problem: why the last call failed; "": it did not.
    """

    def __init__(
        self, window: Window, changed: Callable[[], None], connect: Callable[[str], Gateway] = Gateway
    ) -> None:
        self._window = window
        self._changed = changed
        self._connect = connect
        self._names = Names(window.system)
        self._gateway: Gateway | None = None
        self._is_busy = False
        self.address = self.user = self.role = self.problem = ""
        self.waiting: list[dict[str, Any]] = []

    @property
    def may_answer(self) -> bool:
        """Whether the user's role may answer."""
        return self.role in _ROLES

    def refresh(self) -> None:
        """Reads the requests, or looks for a gateway while nobody has logged in. One call at a time."""
        if self._is_busy:
            return
        self._is_busy = True
        if self._gateway is None:
            self._window.jobs.run(self._window.system.gateway_address, self._found, self._failed, queue=_QUEUE)
        else:
            gateway = self._gateway
            self._window.jobs.run(gateway.approvals, lambda read: self._read(gateway, read), self._failed, queue=_QUEUE)

    def log_in(self, address: str, user: str, secret: str) -> None:
        """Starts a session; see `Gateway.log_in`."""
        gateway = self._connect(address.strip())

        def done(found: tuple[str, str]) -> None:
            self._gateway, self.problem = gateway, ""
            self.user, self.role = found
            self.refresh()
            self._changed()

        self._window.jobs.run(
            lambda: gateway.log_in(user.strip(), secret), done, self._failed, activity="logging in", queue=_QUEUE
        )

    def log_out(self) -> None:
        """Ends the session."""
        if self._gateway is not None:
            self._window.jobs.run(self._gateway.log_out, None, self._failed, queue=_QUEUE)
        self._forget()
        self._changed()

    def answer(self, approval: str, is_approved: bool, reason: str = "") -> None:
        """Approves or rejects a request, exactly as it is in `waiting`."""
        found = next((each for each in self.waiting if each["id"] == approval), None)
        if self._gateway is None or found is None:
            return
        gateway, digest = self._gateway, found["digest"]

        def done(_: None) -> None:
            self.problem = ""
            self._read(gateway, [each for each in self.waiting if each["id"] != approval])

        self._window.jobs.run(
            lambda: gateway.answer(approval, digest, is_approved, reason.strip()),
            done,
            self._failed,
            activity="answering an agent",
            queue=_QUEUE,
        )

    def title(self, approval: dict[str, Any]) -> str:
        """Returns what is asked for in a line."""
        what = approval["what"]
        if "goal" in what:
            return self._names.in_text(goal_sentence(what["goal"], self._names.of))
        return visible(str(what.get("implementation") or what.get("skill") or "changes of the world model"))

    def row(self, approval: dict[str, Any]) -> str:
        """Returns the agent, what it asks for, and the remaining time."""
        left = max(0.0, approval["expires"] - time.time())
        return f"{visible(approval['user'])}: {self.title(approval)} ({left:.0f} s left)"

    def text(self, approval: dict[str, Any]) -> str:
        """Returns all that a person needs for an answer, with names instead of ids."""
        return "\n".join(self._names.in_text(line) for line in _lines(approval, self.title(approval)))

    @staticmethod
    def text_with_ids(approval: dict[str, Any]) -> str:
        """Returns the same text with ids: a label may be misleading."""
        what = approval["what"]
        return "\n".join(map(visible, _lines(approval, what.get("goal") or what.get("skill") or "")))

    def _found(self, address: str) -> None:
        self._is_busy = False
        if address != self.address:
            self.address = address
            self._changed()

    def _read(self, gateway: Gateway, waiting: list[dict[str, Any]]) -> None:
        self._is_busy = False
        if gateway is self._gateway:
            self.waiting = sorted(waiting, key=lambda each: float(each["created"]))
            self._changed()

    def _failed(self, error: Exception) -> None:
        self._is_busy = False
        if not isinstance(error, SkirosError):
            raise error
        self.problem = str(error)
        if isinstance(error, LoggedOut) and self._gateway is not None:
            self._forget()
        self._changed()

    def _forget(self) -> None:
        self._gateway = None
        self.user = self.role = ""
        self.waiting = []


def _lines(approval: dict[str, Any], title: str) -> Iterator[str]:
    what = approval["what"]
    yield from (title, "")
    facts = {
        "Agent": approval["user"],
        "Reason": approval["reason"],
        "Robots": ", ".join(robot.lstrip("/") for robot in approval["robots"]),
        "Job": (what.get("order") or {}).get("id", ""),
        "Starts again": (what.get("retry") or {}).get("id") or (what.get("retry") or {}).get("skill", ""),
        "Parameters": ", ".join(
            f"{key} {value}" for key, value in (what.get("values") or what.get("parameters") or {}).items()
        ),
    }
    yield from (f"{name}: {value}" for name, value in facts.items() if value)
    if "plan" in what:
        yield from ("", "Plan:" if what["plan"] else "Nothing to do: the goal holds already.")
    for number, step in enumerate(what.get("plan", ()), 1):
        arguments = ", ".join(map(str, step["arguments"].values()))
        yield f"  {number}. {step['label']}: {arguments} ({step['robot'].lstrip('/')})"
    if what.get("changes"):
        yield from ("", "Expected changes:", *(f"  {line}" for line in what["changes"]))
    yield from ("", f"Digest {approval['digest'][:16]}")
