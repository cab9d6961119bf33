"""Unique numbers."""

from __future__ import annotations

import itertools
import threading


class IdGen:
    """Allocates the lowest free number. Thread-safe."""

    def __init__(self) -> None:
        self._used: set[int] = set()
        self._lock = threading.Lock()

    def getId(self, desired: int = -1) -> int:
        """Allocates the desired number (from 0), or the next free one."""
        with self._lock:
            number = next(n for n in itertools.count(max(desired, 0)) if n not in self._used)
            self._used.add(number)
            return number

    def hasId(self, uid: int) -> bool:
        """Whether the number is in use."""
        return uid in self._used

    def removeId(self, uid: int) -> None:
        """Releases the number."""
        self._used.discard(uid)

    def clear(self) -> None:
        """Releases all numbers."""
        self._used.clear()
