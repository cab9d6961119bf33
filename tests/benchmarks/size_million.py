"""A scene of a million elements beside one of 1000, as in `size`: 5 minutes and 16 GB, so only when it is named."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks import size
from benchmarks.measurement import Measurement


def measure(folder: Path) -> Iterator[Measurement]:
    return size.measure(folder, (size.SIZES[0], 1_000_000))
