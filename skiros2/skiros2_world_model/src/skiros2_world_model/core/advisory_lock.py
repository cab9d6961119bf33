"""An advisory lock for clients. It does not restrict access to the world model."""

from __future__ import annotations

import threading


class AdvisoryLock:
    """A lock with one owner, which any client may release. Thread-safe."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self.owner: str | None = None

    def acquire(self, owner: str, timeout: float | None = None) -> bool:
        """Blocks until the lock is free and acquires it. Returns False at the timeout.

        :param owner: the name of the new owner.
        :param timeout: in s; None: no limit.
        """
        with self._free:
            if not self._free.wait_for(lambda: self.owner is None, timeout):
                return False
            self.owner = owner
            return True

    def release(self, owner: str | None = None) -> bool:
        """Releases the lock. Returns False when it is free, or held by another owner than `owner` (None: any)."""
        with self._free:
            if self.owner is None or owner not in (None, self.owner):
                return False
            self.owner = None
            self._free.notify()
            return True
