"""Python's cyclic garbage collector, while many objects that stay are made."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collector_paused() -> Iterator[None]:
    """Makes no collections within the block, or the decorated function; any thread, also several at once.

    A collection visits all objects: it would take a third of the time in which a large scene is read, without cycles.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()
