"""A journal whose disk is full."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from skiros2_world_model.core.journal import Journal


@contextmanager
def full_disk(journal: Journal) -> Iterator[None]:
    """Nothing can be written within the block: neither to the log, nor to the tables."""
    journal.flush()
    log = journal._log._fd
    kept, full = os.dup(log), os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, log)
    journal._file.writer.execute("PRAGMA query_only=ON")
    try:
        yield
    finally:
        journal._file.writer.execute("PRAGMA query_only=OFF")
        os.dup2(kept, log)
        os.close(kept)
        os.close(full)
