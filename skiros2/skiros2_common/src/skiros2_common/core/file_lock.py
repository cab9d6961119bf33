"""A file that one process owns."""

from __future__ import annotations

import fcntl
import time
from pathlib import Path
from typing import IO

from skiros2_common.core.errors import ConfigurationError

#: How long a process waits for its predecessor to exit (s).
_TIMEOUT = 5.0
_PERIOD = 0.05


class FileInUse(ConfigurationError):
    """Another process owns the file."""


def own_file(path: Path | str, timeout: float | None = None) -> IO[bytes]:
    """Lock a file for the lifetime of the process, by another one beside it: `path` with the suffix `.lock`.

    For stores in SQLite, whose locks only separate transactions.

    :param timeout: how long to wait for its owner's end (s); None: some seconds.
    :returns: close it to release the lock.
    :raises FileInUse: another process, or another part of this one, still owns it after that time.
    :raises OSError: the lock file cannot be opened.
    """
    lock = open(f"{path}.lock", "wb")  # noqa: SIM115 - stays open
    deadline = time.monotonic() + (_TIMEOUT if timeout is None else timeout)
    while True:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return lock
        except BlockingIOError:
            if time.monotonic() >= deadline:
                lock.close()
                raise FileInUse(f"{path}: another process is using it") from None
            time.sleep(_PERIOD)
