"""The lock that clients may agree to use among themselves; it keeps nobody from anything."""

from __future__ import annotations

import threading


class AdvisoryLock:
    """Taken by one at a time. Whoever asks may give it back. Safe to use from all threads."""

    def __init__(self) -> None:
        self._free = threading.Condition()
        self.owner: str | None = None

    def take(self, owner: str, timeout: float | None = None) -> bool:
        """Waits until it is free and takes it; False when that takes longer than `timeout` seconds (None: for ever).

        :param owner: who takes it, for others to see.
        """
        with self._free:
            if not self._free.wait_for(lambda: self.owner is None, timeout):
                return False
            self.owner = owner
            return True

    def give_back(self, owner: str | None = None) -> bool:
        """Makes it free; False when it was free, or taken by somebody else than `owner` (None: whoever it is)."""
        with self._free:
            if self.owner is None or owner not in (None, self.owner):
                return False
            self.owner = None
            self._free.notify()
            return True
