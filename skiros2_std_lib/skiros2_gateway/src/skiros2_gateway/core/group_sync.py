"""Brings what an SQLite file's write-ahead log has got to the disk, in a thread: the event loop waits for no disk."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sqlite3
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from skiros2_gateway.core.problems import StoreFailed

log = logging.getLogger(__name__)

#: The size of the log (bytes) from which those who write wait until it is copied and empty. It grows so far only if
#: there is no moment without transactions.
LOG_LIMIT = 16 * 2**20


class GroupSync:
    """One sync serves all transactions that were committed before it began (group commit).

    The connection that writes commits with `synchronous = NORMAL` and `wal_autocheckpoint = 0`: a commit is a write to
    the log without a sync, and survives the end of the process. Its methods are called in the thread of the loop.

    :param path: of the file, which is open in another connection; its log exists.
    """

    def __init__(self, path: Path | str) -> None:
        self._log = os.open(f"{path}-wal", os.O_RDONLY)
        self._db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        self._thread = ThreadPoolExecutor(1, "store")
        self._running: asyncio.Future[None] | None = None
        self._next: asyncio.Future[None] | None = None  # of those who wait for the sync after the running one

    def close(self) -> None:
        """Waits for the thread."""
        self._thread.shutdown()
        self._db.close()
        os.close(self._log)

    def request(self) -> asyncio.Future[None]:
        """Returns a future that is done when all that was committed is on the disk; callbacks run in their order.

        It has the exception `StoreFailed` if the disk refuses.
        """
        if self._running is None:
            self._running = future = self._begin()
        else:  # what was committed since the running sync began may be missing in it
            self._next = future = self._next or asyncio.get_running_loop().create_future()
        return future

    def checkpoint(self) -> None:
        """Has the log copied to the file, in the thread, while others may write. To be called now and then."""
        self._thread.submit(self._checkpoint)

    def _begin(self, future: asyncio.Future[None] | None = None) -> asyncio.Future[None]:
        loop = asyncio.get_running_loop()
        self._thread.submit(self._sync, lambda error: loop.call_soon_threadsafe(self._on_end, error))
        return future or loop.create_future()

    def _on_end(self, error: OSError | None) -> None:
        ended, self._running = self._running, None
        if self._next is not None:
            self._running, self._next = self._begin(self._next), None
        if ended is None or ended.cancelled():
            return
        if error is None:
            ended.set_result(None)
        else:
            ended.set_exception(StoreFailed(f"the job store cannot be written: {error}"))
            ended.exception()  # nobody may wait

    # -- in the thread -----------------------------------------------------------------------------------------

    def _sync(self, report: Callable[[OSError | None], Any]) -> None:
        error = None
        try:
            os.fdatasync(self._log)
        except OSError as found:
            error = found
        with contextlib.suppress(RuntimeError):  # the loop has ended meanwhile
            report(error)

    def _checkpoint(self) -> None:
        try:
            self._db.execute("PRAGMA wal_checkpoint(PASSIVE)").fetchall()
            if os.fstat(self._log).st_size > LOG_LIMIT:
                self._db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            # The first transaction after it begins the log again, and waits for the disk: this one, no other.
            [(version,)] = self._db.execute("PRAGMA user_version").fetchall()
            self._db.execute(f"PRAGMA user_version = {version}")
        except sqlite3.Error as error:
            log.warning("the log of the job store grows until the next attempt: %s", error)
