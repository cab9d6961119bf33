"""Idempotency keys: a command that a client repeats with its key is carried out once, and answered as before."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Protocol

from skiros2_common.core.errors import Conflict, SkirosError, TimedOut
from skiros2_gateway.core.approvals import digest_of
from skiros2_gateway.core.job import STOPS
from skiros2_gateway.core.problems import Problem, Rejected, StoreFailed

log = logging.getLogger(__name__)

#: The longest key.
MAX_KEY = 200
#: How many keys a `KeyMemory` has.
MAX_IN_MEMORY = 2000
#: Codes of errors after which a command may be carried out yet: the cell has not answered, in time or at all.
_UNANSWERED = (TimedOut.code, SkirosError.code)


class Keep(Enum):
    """When a key is written. One that is not kept is shared only by clients that wait at the same time."""

    BEFORE = auto()  # the command is not repeated after a restart of the gateway either
    AFTER = auto()  # a stop does not wait for the disk
    NOT = auto()


def keep_of(method: str) -> Keep:
    """Returns when the key of a method of jobs, in small letters, is written."""
    return Keep.AFTER if method in STOPS else Keep.BEFORE


@dataclass
class _Running:
    digest: str
    task: asyncio.Task[Any]
    waiting: int = 0


class KeyStore(Protocol):
    """Where keys are written to. Its methods raise `StoreFailed`."""

    def put_key(self, user: str, key: str, digest: str) -> None: ...

    def answer_key(self, user: str, key: str, answer: str) -> None: ...

    def delete_key(self, user: str, key: str) -> None: ...

    def find_key(self, user: str, key: str) -> tuple[str, str] | None: ...

    async def synced(self) -> None: ...


class KeyMemory:
    """A store of the newest keys that ends with its process."""

    def __init__(self) -> None:
        self._keys: dict[tuple[str, str], tuple[str, str]] = {}

    def put_key(self, user: str, key: str, digest: str) -> None:
        self._keys[user, key] = digest, ""
        while len(self._keys) > MAX_IN_MEMORY:
            del self._keys[next(iter(self._keys))]

    def answer_key(self, user: str, key: str, answer: str) -> None:
        if (user, key) in self._keys:
            self._keys[user, key] = self._keys[user, key][0], answer

    def delete_key(self, user: str, key: str) -> None:
        self._keys.pop((user, key), None)

    def find_key(self, user: str, key: str) -> tuple[str, str] | None:
        return self._keys.get((user, key))

    async def synced(self) -> None:
        """Does nothing: there is no disk."""


class Keys:
    """The keys of all users. To be used in the thread of the gateway's loop.

    An answer is written when its command has been carried out.
    """

    def __init__(self, store: KeyStore) -> None:
        self._store = store
        self._running: dict[tuple[str, str], _Running] = {}

    async def once(
        self, user: str, key: str, command: Any, do: Callable[[], Awaitable[Any]], keep: Keep = Keep.BEFORE
    ) -> Any:
        """Carries out a command, unless the user has sent it before with this key. Returns the answer.

        A command that was refused has changed nothing, and may be sent again. When no client waits for it, the
        command is cancelled.

        :param key: chosen by the client; "": the command is carried out.
        :param command: identifies it, as JSON data.
        :param do: carries it out. Returns JSON data.
        :raises Conflict: the key belongs to another command, or it is unknown how the command has ended.
        :raises SkirosError: what `do` raises.
        """
        if not key:
            return await do()
        if len(key) > MAX_KEY or not key.isprintable():
            expected = f"at most {MAX_KEY} printable characters"
            raise Rejected([Problem("wrong_value", "key", "the idempotency key is invalid", expected)])
        digest = digest_of(command)
        running = self._running.get((user, key))
        known = self._find(user, key) if running is None and keep is not Keep.NOT else None
        if (running.digest if running else known[0] if known else digest) != digest:
            raise Conflict(f"the key {key!r} was sent with another command before")
        if known is not None:
            if not known[1]:
                raise Conflict(f"it is unknown how the command with the key {key!r} has ended; read the state")
            return json.loads(known[1])
        if running is None:
            work = do() if keep is Keep.NOT else self._carry_out(user, key, digest, do, keep)
            running = self._running[user, key] = _Running(digest, asyncio.ensure_future(work))
            running.task.add_done_callback(lambda _: self._running.pop((user, key), None))
        running.waiting += 1
        try:
            return await asyncio.shield(running.task)
        except asyncio.CancelledError:
            if running.waiting == 1:
                running.task.cancel()
            raise
        finally:
            running.waiting -= 1

    async def _carry_out(self, user: str, key: str, digest: str, do: Callable[[], Awaitable[Any]], keep: Keep) -> Any:
        if keep is Keep.BEFORE:
            self._write(self._store.put_key, user, key, digest)
            await self._synced(user, key)
        try:
            answer = await do()
        except (SkirosError, asyncio.CancelledError) as error:
            if not (isinstance(error, SkirosError) and error.code in _UNANSWERED):
                self._write(self._store.delete_key, user, key)
            raise
        if keep is Keep.AFTER:
            self._write(self._store.put_key, user, key, digest)
        self._write(self._store.answer_key, user, key, json.dumps(answer, default=str))
        await self._synced(user, key)
        return answer

    def _find(self, user: str, key: str) -> tuple[str, str] | None:
        try:
            return self._store.find_key(user, key)
        except StoreFailed as error:
            log.error("the key %s of %s cannot be looked up: %s", key, user, error)
            return None

    def _write(self, write: Callable[..., None], *arguments: str) -> None:
        try:
            write(*arguments)
        except StoreFailed as error:  # robots stop, whatever the disk does
            log.error("the key %s of %s is not written: %s", arguments[1], arguments[0], error)

    async def _synced(self, user: str, key: str) -> None:
        try:
            await self._store.synced()
        except StoreFailed as error:
            log.error("the key %s of %s is lost by a power failure: %s", key, user, error)


async def uninterrupted(work: Awaitable[Any]) -> Any:
    """Awaits what must not be left half-done, also when the caller is cancelled meanwhile."""
    task = asyncio.ensure_future(work)
    while True:
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():  # the gateway ends
                raise
