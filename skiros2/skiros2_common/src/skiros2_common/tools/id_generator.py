"""Unique numbers."""

from __future__ import annotations

import threading


class IdGen:
    """Allocates the lowest free number. Thread-safe."""

    def __init__(self) -> None:
        self._used: set[int] = set()
        self._lowest = 0
        self._lock = threading.Lock()

    def getId(self, desired: int = -1) -> int:
        """Allocates the desired number (from 0), or the next free one."""
        with self._lock:
            number = desired if desired >= 0 else self._lowest
            while number in self._used:
                number += 1
            self._used.add(number)
            if desired < 0:
                self._lowest = number + 1
            return number

    def hasId(self, uid: int) -> bool:
        """Whether the number is in use."""
        return uid in self._used

    def removeId(self, uid: int) -> None:
        """Releases the number."""
        with self._lock:
            self._used.discard(uid)
            self._lowest = min(self._lowest, uid)

    def clear(self) -> None:
        """Releases all numbers."""
        with self._lock:
            self._used.clear()
            self._lowest = 0
