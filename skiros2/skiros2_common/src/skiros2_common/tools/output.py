"""Output of libraries in C: PyBullet prints a banner when it is imported, and warnings."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

STDOUT, STDERR = 1, 2


def discard(descriptor: int) -> None:
    """Discards all that this process writes to a file descriptor."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


@contextmanager
def discarded(descriptor: int) -> Iterator[None]:
    """Inside the `with` block, discards what this process writes to a file descriptor. For imports."""
    kept = os.dup(descriptor)
    try:
        discard(descriptor)
        yield
    finally:
        os.dup2(kept, descriptor)
        os.close(kept)
