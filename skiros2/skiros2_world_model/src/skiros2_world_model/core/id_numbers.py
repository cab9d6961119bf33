"""The numbers of the ids of a scene."""

from __future__ import annotations

from collections.abc import Sequence

from skiros2_common.core.names import LAST_ID_NUMBER, id_number


class IdNumbers:
    """Counts the ids that have a number, and finds free ones."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        #: All numbers from this one on are free; it never goes down, so that no id is given twice.
        self.next = 0

    def reserve(self, number: int) -> None:
        """No number below this one is given from now on."""
        self.next = max(self.next, number)

    def count(self, eid: str, change: int) -> None:
        """One more (1) or one less (-1) element has that id."""
        number = id_number(eid)
        if number < 0:
            return
        count = self._counts.get(number, 0) + change
        if count:
            self._counts[number] = count
            self.reserve(number + 1)
        else:
            del self._counts[number]

    def free(self, desired: int, others: Sequence[IdNumbers]) -> int:
        """The desired number (from 0) if it is free here and there, else the next free one."""
        everywhere = (self, *others)
        highest = max(numbers.next for numbers in everywhere)
        number = desired if desired >= 0 else highest
        if number in self._counts and len(self._counts) >= self.next:
            number = highest  # all below are taken
        while number > LAST_ID_NUMBER or any(number in numbers._counts for numbers in everywhere):
            number = number + 1 if number < LAST_ID_NUMBER else 0
        return number
