"""What a command answers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from skiros2_common.core.errors import SkirosError

#: Exit statuses.
OK, REFUSED, USAGE, NOT_THERE = 0, 1, 2, 3


class WrongUsage(SkirosError):
    """The arguments are wrong whatever the state of the system; ends with `USAGE`."""


@dataclass
class Answer:
    """What is printed, and the exit status.

    :param lines: for people.
    :param data: for programs, as JSON has it; or what makes it, where that takes time.
    """

    lines: list[str] = field(default_factory=list)
    data: Any = None
    status: int = OK
