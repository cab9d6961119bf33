"""The revision of all properties, parameters and elements of this process, and of its copy of the world model.

As long as the revision stays the same, none of them has changed.
"""

from __future__ import annotations

import itertools


class Revision:
    """A counter that `advance` sets to a number it never had before. Thread-safe."""

    __slots__ = ("_numbers", "current")

    def __init__(self) -> None:
        self.current = 0
        self._numbers = itertools.count(1)

    def advance(self) -> None:
        """Records a change."""
        self.current = next(self._numbers)  # atomic; `+= 1` in two threads could repeat a number


local_revision = Revision()
