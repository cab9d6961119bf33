"""Approvals: a person agrees before something that an agent asks for starts."""

from __future__ import annotations

import asyncio
import itertools
import time
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.errors import Refused, UnknownName
from skiros2_gateway.core.access import Caller
from skiros2_gateway.core.events import EventStream
from skiros2_gateway.core.problems import Denied


@dataclass(frozen=True)
class Approval:
    """A request that waits for an answer.

    :param user: who asks; the answer has to come from somebody else.
    :param what: the order and its plan, the skill and its start check, or the proposal; as JSON data.
    :param created: s since the epoch.
    """

    number: int
    user: str
    what: dict[str, Any]
    created: float

    def to_dict(self) -> dict[str, Any]:
        return dict(vars(self))


class Approvals:
    """The open requests. To be used in the thread of the gateway's loop.

    :param is_needed: False: requests that need no person are approved by configuration.
    :param timeout: a request without an answer is refused after this time (s).
    """

    def __init__(self, events: EventStream, *, is_needed: bool = True, timeout: float = 300.0) -> None:
        self._events = events
        self._is_needed = is_needed
        self._timeout = timeout
        self._numbers = itertools.count(1)
        self._open: dict[int, tuple[Approval, asyncio.Future[tuple[str, bool]]]] = {}

    @property
    def open(self) -> list[Approval]:
        return [approval for approval, _ in self._open.values()]

    async def request(self, caller: Caller, what: dict[str, Any], *, by_person: bool = False) -> str:
        """Publishes an event `approval` and waits for an answer. Returns the name of the user who approves.

        :param by_person: whether a person has to approve it, whatever the configuration is.
        :raises Refused: it is rejected, or nobody answers in time.
        """
        if not (self._is_needed or by_person):
            return "configuration"
        approval = Approval(next(self._numbers), caller.user, what, time.time())
        answer: asyncio.Future[tuple[str, bool]] = asyncio.get_running_loop().create_future()
        self._open[approval.number] = approval, answer
        self._events.publish("approval", approval.to_dict())
        try:
            user, is_approved = await asyncio.wait_for(answer, self._timeout)
        except TimeoutError:
            raise Refused(f"nobody has approved it within {self._timeout:g} s") from None
        finally:
            del self._open[approval.number]
            self._events.publish("approval", {"number": approval.number, "ended": True})
        if not is_approved:
            raise Refused(f"{user} has rejected it")
        return user

    def answer(self, caller: Caller, number: int, is_approved: bool) -> Approval:
        """Approves or rejects a request. Check the role before.

        :raises UnknownName: no request with this number is open.
        :raises Denied: the caller is no person, or the one who asks.
        """
        if number not in self._open:
            raise UnknownName(f"approval {number} is not open; open: {', '.join(map(str, self._open)) or 'none'}")
        approval, answer = self._open[number]
        if not caller.person:
            raise Denied(f"{caller.user} is not marked as a person; only persons answer")
        if caller.user == approval.user:
            raise Denied(f"{caller.user} has made the request; another user has to answer it")
        if not answer.done():
            answer.set_result((caller.user, is_approved))
        return approval
