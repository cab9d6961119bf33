"""Approvals: a person agrees before something that an agent asks for starts."""

from __future__ import annotations

import asyncio
import hashlib
import json
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from skiros2_common.core.errors import Conflict, Refused, UnknownName
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.problems import Denied

#: Requests that may wait at once: of all users, and of one.
MAX_OPEN, MAX_OPEN_OF_USER = 50, 10


class Ending(StrEnum):
    """How a request has ended."""

    APPROVED = "approved"
    REJECTED = "rejected"
    EXPIRED = "expired"  # nobody has answered in time
    WITHDRAWN = "withdrawn"  # the client has gone
    REVOKED = "revoked"  # the user may not ask for it any more

    @property
    def is_answer(self) -> bool:
        """Whether a person has answered."""
        return self in (Ending.APPROVED, Ending.REJECTED)


@dataclass(frozen=True)
class Request:
    """A request of an agent.

    :param runs: exactly what will run, as JSON data: the order and its plan, the skill with its values, or edits.
    :param shown: what a person reads beside it, such as the simulated changes.
    :param robots: node names of the robots that move.
    :param reason: of the agent.
    """

    runs: dict[str, Any]
    shown: dict[str, Any] = field(default_factory=dict)
    robots: tuple[str, ...] = ()
    reason: str = ""

    @property
    def digest(self) -> str:
        """Identifies exactly what will run."""
        return digest_of(self.runs)


def digest_of(data: Any) -> str:
    """Returns the SHA-256 of JSON data, as hexadecimal digits."""
    return hashlib.sha256(json.dumps(data, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@dataclass(frozen=True)
class Approval:
    """A request that waits for an answer.

    :param id: random; differs after each start of the gateway.
    :param user: who asks; the answer has to come from somebody else.
    :param created, expires: s since the epoch.
    """

    id: str
    user: str
    request: Request
    created: float
    expires: float

    def to_dict(self) -> dict[str, Any]:
        """Returns the approval as JSON data; see `GET /api/approvals`."""
        asked = self.request
        return {
            "id": self.id,
            "digest": asked.digest,
            "user": self.user,
            "what": {**asked.runs, **asked.shown},
            "robots": list(asked.robots),
            "reason": asked.reason,
            "created": self.created,
            "expires": self.expires,
        }


@dataclass(frozen=True)
class _Open:
    approval: Approval
    caller: Caller
    answer: asyncio.Future[tuple[str, bool, str]]


class Approvals:
    """The open requests. To be used in the thread of the gateway's loop.

    :param is_needed: False: requests that need no person are approved by configuration.
    :param timeout: a request without an answer is refused after this time (s).
    """

    def __init__(self, events: EventStream, *, is_needed: bool = True, timeout: float = 300.0) -> None:
        self._events = events
        self._is_needed = is_needed
        self._timeout = timeout
        self._open: dict[str, _Open] = {}

    @property
    def open(self) -> list[Approval]:
        return [each.approval for each in self._open.values()]

    async def request(self, caller: Caller, asked: Request, *, by_person: bool = False) -> str:
        """Publishes an event `approval` and waits for an answer. Returns the name of the user who approves.

        A second event has the `id`, the `Ending` as `ended`, and `text`. The request is withdrawn when the caller's
        task is cancelled.

        :param by_person: whether a person has to approve it, whatever the configuration is.
        :raises Refused: it is rejected, nobody answers in time, or too many requests wait.
        """
        if not (self._is_needed or by_person):
            return "configuration"
        own = sum(approval.user == caller.user for approval in self.open)
        if own >= MAX_OPEN_OF_USER or len(self._open) >= MAX_OPEN:
            raise Refused(f"{own} requests of {caller.user}, {len(self._open)} in all, wait for an answer already")
        now = time.time()
        approval = Approval(secrets.token_hex(8), caller.user, asked, now, now + self._timeout)
        answer: asyncio.Future[tuple[str, bool, str]] = asyncio.get_running_loop().create_future()
        self._open[approval.id] = _Open(approval, caller, answer)
        self._events.publish("approval", approval.to_dict())
        ending, text = Ending.WITHDRAWN, "withdrawn: the client has gone"
        try:
            user, is_approved, why = await asyncio.wait_for(answer, self._timeout)
            ending, because = Ending.APPROVED if is_approved else Ending.REJECTED, f": {why}" if why else ""
            text = f"{ending} by {user}{because}"
        except TimeoutError:
            ending, text = Ending.EXPIRED, f"nobody has approved it within {self._timeout:g} s"
            raise Refused(text) from None
        except Refused as error:
            ending, text = Ending.REVOKED, str(error)
            raise
        finally:
            self._open.pop(approval.id, None)
            self._events.publish("approval", {"id": approval.id, "ended": ending, "text": text})
        if not is_approved:
            raise Refused(f"{user} has rejected it{because}")
        return user

    def answer(
        self, caller: Caller, approval_id: str, is_approved: bool, digest: str = "", reason: str = ""
    ) -> Approval:
        """Approves or rejects a request. Check the role before.

        :param digest: of what the person has read; "": not compared.
        :param reason: of the person, for the agent.
        :raises UnknownName: no request with this id is open.
        :raises Denied: the caller is not a person, or is the one who asks.
        :raises Conflict: the request has another digest.
        """
        if approval_id not in self._open:
            raise UnknownName(f"approval {approval_id!r} is not open; open: {', '.join(self._open) or 'none'}")
        approval, answer = self._open[approval_id].approval, self._open[approval_id].answer
        if not caller.person:
            raise Denied(f"{caller.user} is not marked as a person; only persons answer")
        if caller.user == approval.user:
            raise Denied(f"{caller.user} has made the request; another user has to answer it")
        if digest and digest != approval.request.digest:
            raise Conflict(f"approval {approval_id} has the digest {approval.request.digest}, not {digest}")
        if answer.done():
            raise UnknownName(f"approval {approval_id} has just ended")
        del self._open[approval_id]
        answer.set_result((caller.user, is_approved, reason.strip()))
        return approval

    def withdraw(self, is_revoked: Callable[[Caller], bool]) -> None:
        """Withdraws the requests of callers whose credentials or role were revoked."""
        for each in list(self._open.values()):
            if is_revoked(each.caller) and not each.answer.done():
                each.answer.set_exception(Refused(f"withdrawn: {each.caller.user} may not ask for it any more"))
