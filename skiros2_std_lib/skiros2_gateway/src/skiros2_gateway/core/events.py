"""One numbered stream of events for all viewers, which can be resumed after a lost connection."""

from __future__ import annotations

import asyncio
import secrets
import time
from collections import deque
from collections.abc import AsyncIterator, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from skiros2_gateway.core.json_text import json_text

#: How many events are kept for viewers that resume: some 4 MB, and more than a minute of a busy cell.
_KEPT = 2_000
#: How many events a viewer may be behind before its queue is dropped and it is told to read the state again.
_BEHIND = 2_000


@dataclass(frozen=True)
class Event:
    """An event.

    :param number: increases by 1 with each event of a stream.
    :param kind: `job`, `response`, `robot`, `cell`, `queue`, `world` or `reset`; other parts of the gateway add kinds.
    :param time: s since the epoch.
    """

    stream: str
    number: int
    kind: str
    time: float
    data: Any

    @property
    def id(self) -> str:
        """The id to resume after."""
        return f"{self.stream}-{self.number}"

    @cached_property
    def json(self) -> str:
        """The event as JSON, encoded once for all viewers."""
        event = {"id": self.id, "kind": self.kind, "time": self.time, "data": self.data}
        return json_text(event)

    @cached_property
    def message(self) -> bytes:
        """The event as a server-sent event, encoded once for all viewers."""
        return f"id: {self.id}\nevent: {self.kind}\ndata: {self.json}\n\n".encode()


class EventStream:
    """Events for any number of viewers. To be used in the thread of the gateway's loop.

    :param kept: how many events are kept for viewers that resume.
    :param behind: how many events a viewer may be behind.
    """

    def __init__(self, kept: int = _KEPT, behind: int = _BEHIND) -> None:
        #: Differs after each start of the gateway.
        self.name = secrets.token_hex(4)
        self._number = 0
        self._events: deque[Event] = deque(maxlen=kept)
        self._behind = behind
        self._viewers: set[asyncio.Queue[Event | None]] = set()

    @property
    def last_id(self) -> str:
        """The id of the last event. A state read now includes all events up to it."""
        return f"{self.name}-{self._number}"

    @property
    def viewers(self) -> int:
        """How many viewers are connected."""
        return len(self._viewers)

    def publish(self, kind: str, data: Any) -> Event:
        """Sends an event to all viewers.

        :param data: JSON data, which must not change afterwards.
        """
        self._number += 1
        event = Event(self.name, self._number, kind, time.time(), data)
        self._events.append(event)
        for queue in self._viewers:
            if queue.qsize() < self._behind:
                queue.put_nowait(event)
            elif queue.qsize() == self._behind:
                queue.put_nowait(None)  # the viewer has missed events
        return event

    async def follow(self, after: str = "", kinds: Collection[str] = ()) -> AsyncIterator[Event]:
        """Yields events until the caller ends the iteration.

        Where events are missing (the stream is another one, or the viewer was too slow), an event `reset` comes first:
        the viewer then has to read the state again.

        :param after: the id of the last event that the viewer knows; "": only new events.
        :param kinds: empty: all.
        """
        queue: asyncio.Queue[Event | None] = asyncio.Queue()
        for missed in self._missed(after):
            queue.put_nowait(missed)
        self._viewers.add(queue)
        try:
            while True:
                event = await queue.get()
                if event is None:
                    while not queue.empty():
                        queue.get_nowait()
                    event = self._reset()
                if not kinds or event.kind in kinds or event.kind == "reset":
                    yield event
        finally:
            self._viewers.discard(queue)

    def _missed(self, after: str) -> list[Event]:
        if not after:
            return []
        stream, _, number = after.rpartition("-")
        first = self._events[0].number if self._events else self._number + 1
        is_number = len(number) < 20 and number.isascii() and number.isdecimal()
        if stream != self.name or not is_number or not first - 1 <= int(number) <= self._number:
            return [self._reset()]
        return [event for event in self._events if event.number > int(number)]

    def _reset(self) -> Event:
        return Event(self.name, self._number, "reset", time.time(), {})
