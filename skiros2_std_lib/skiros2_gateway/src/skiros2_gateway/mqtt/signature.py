"""Signed commands: a broker does not say who has sent a message, and all who may read a topic would read a token.

A message is {user, command, signature}. `command` is a JSON text with `time` (s since the epoch) beside the fields of
the method. `signature` is the HMAC-SHA256, as hexadecimal digits, of the text METHOD, a line break and `command`; the
key is the SHA-256 of the user's token, as hexadecimal digits.

`TOKEN=... python3 -m skiros2_gateway.mqtt.signature USER METHOD FIELDS` prints a message with the fields (JSON).
"""

from __future__ import annotations

import hashlib
import hmac
import json
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Mapping
from itertools import islice
from typing import Any

from skiros2_gateway.core.problems import StoreFailed, Unauthenticated
from skiros2_gateway.core.store import JobStore

log = logging.getLogger(__name__)

#: The most by which the clocks of client and gateway may differ (s).
_TOLERANCE = 60.0
#: How many signatures are known at least: the clock may be set back, and an old command come again.
_KEPT = 10_000


def sign(user: str, token: str, method: str, fields: Mapping[str, Any], now: float | None = None) -> str:
    """Returns a message with a command.

    :param method: the last part of the topic, such as `store`.
    :param now: s since the epoch; None: now.
    """
    command = json.dumps({"time": time.time() if now is None else now, **fields})
    signature = signature_of(hashlib.sha256(token.encode()).hexdigest(), method, command)
    return json.dumps({"user": user, "command": command, "signature": signature})


def signature_of(key: str, method: str, command: str) -> str:
    """Returns the signature of a command, as hexadecimal digits.

    :param key: the SHA-256 of the token, as hexadecimal digits.
    """
    text = f"{method}\n{command}".encode("utf-8", "surrogatepass")
    return hmac.new(key.encode(), text, hashlib.sha256).hexdigest()


class Freshness:
    """Refuses commands that are old or come again, also after a restart. To be used in the thread of the store.

    What `check` has accepted is known after a restart once `write` was called: before the command is carried out, but
    after a stop, which does not wait for the disk.

    :param clock: s since the epoch.
    :param monotonic: s.
    :raises StoreFailed: the store cannot be read.
    """

    def __init__(
        self, store: JobStore, clock: Callable[[], float] = time.time, monotonic: Callable[[], float] = time.monotonic
    ) -> None:
        self._store = store
        self._clock = clock
        self._monotonic = monotonic
        self._seen = dict.fromkeys(store.signatures(), monotonic())  # the oldest first
        self._unwritten: dict[str, float] = {}

    def check(self, signature: str, sent: Any) -> None:
        """Checks a command whose signature is right.

        :param sent: its field `time`.
        :raises Unauthenticated: it is old, or was received before.
        """
        now = self._clock()
        is_number = isinstance(sent, int | float) and not isinstance(sent, bool) and math.isfinite(sent)
        if not is_number or not abs(now - sent) <= _TOLERANCE:
            raise Unauthenticated(f"the command's time is {sent!r}, expected {now:.0f} within {_TOLERANCE:g} s")
        if signature in self._seen:
            raise Unauthenticated("the command was received before")
        self._seen[signature], self._unwritten[signature] = self._monotonic(), sent

    async def write(self) -> None:
        """Writes the signatures of commands that were accepted, on the disk, and deletes old ones."""
        if not self._unwritten:
            return
        now = self._monotonic()
        while self._unwritten:
            signature, sent = self._unwritten.popitem()
            beyond = islice(self._seen.items(), max(0, len(self._seen) - _KEPT))
            expired = [key for key, at in beyond if now - at > 2 * _TOLERANCE]
            for key in expired:
                del self._seen[key]
            try:
                self._store.put_signature(signature, sent, expired)
            except StoreFailed as error:  # robots stop, whatever the disk does
                log.error("a signature is not written: after a restart its command could come again: %s", error)
        try:
            await self._store.synced()
        except StoreFailed as error:
            log.error("signatures are lost by a power failure: their commands could come again: %s", error)


if __name__ == "__main__":
    sys.stdout.write(sign(sys.argv[1], os.environ["TOKEN"], sys.argv[2], json.loads(sys.argv[3])) + "\n")
