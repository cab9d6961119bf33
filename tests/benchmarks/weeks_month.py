"""A journal of ten million entries, of a busy month, as in `weeks`: minutes and gigabytes, so only when it is named."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks import weeks
from benchmarks.measurement import Measurement


def measure(folder: Path) -> Iterator[Measurement]:
    return weeks.measure(folder, 10_000_000)
