"""What a command answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

#: Exit statuses.
OK, REFUSED, USAGE, NOT_THERE = 0, 1, 2, 3


@dataclass
class Answer:
    """What is printed, and the exit status.

    :param lines: for people.
    :param data: for programs, as JSON has it; or what makes it, where that takes time.
    """

    lines: list[str] = field(default_factory=list)
    data: Any = None
    status: int = OK
