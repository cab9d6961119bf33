"""A mark that changes with every change of a property, parameter or element in this process, and of a world model as
it is known here.

Who keeps the mark and finds it unchanged later knows that nothing was changed in between.
"""

from __future__ import annotations

import itertools


class Mutations:
    __slots__ = ("_numbers", "mark")

    def __init__(self) -> None:
        self.mark = 0
        self._numbers = itertools.count(1)

    def note(self) -> None:
        """Something was changed. Any thread; each call sets a mark that never was before."""
        self.mark = next(self._numbers)  # atomic, where `+= 1` of two threads could bring an old mark back


mutations = Mutations()
