"""How much generated tests try."""

from __future__ import annotations

import os

#: The number in the environment; 0 if there is none.
FUZZ = int(os.environ.get("FUZZ", "0"))


def examples(number: int) -> int:
    """How many examples a generated test has: with `FUZZ=1` this number, with `FUZZ=50` 50 times as many.

    Without FUZZ a fourth: the examples are the same each time, so that more of them find nothing new.
    """
    return number * FUZZ if FUZZ else max(number // 4, 5)
