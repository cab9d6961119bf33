"""Refused requests in the audit log: few entries, however many requests come."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

#: For this long, refusals of one kind are counted after the first one (s).
_PERIOD = 60.0
#: Kinds that are counted at once; refusals of further kinds are counted together.
_MAX_KINDS = 100

_OTHERS = ("", "", "others", "")


@dataclass
class _Counted:
    begin: float
    last: Mapping[str, Any]
    more: int = 0


class Refusals:
    """Writes the first refusal of each kind, and then the number of those that followed within a minute.

    Refusals are of one kind if `user`, `way`, `action` and `outcome` are the same.

    :param write: takes an entry of the audit log.
    :param clock: monotonic (s).
    """

    def __init__(self, write: Callable[[Mapping[str, Any]], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._write = write
        self._clock = clock
        self._counted: dict[tuple[Any, ...], _Counted] = {}

    def add(self, entry: Mapping[str, Any]) -> None:
        """Writes or counts a refused request."""
        self.write_ended()
        kind = tuple(entry[name] for name in ("user", "way", "action", "outcome"))
        if kind not in self._counted and len(self._counted) >= _MAX_KINDS:
            kind, entry = _OTHERS, {**entry, "user": "", "action": "others", "object": "", "outcome": "refused"}
        counted = self._counted.get(kind)
        if counted is None:
            self._counted[kind] = _Counted(self._clock(), entry)
            self._write(entry)
        else:
            counted.more += 1
            counted.last = entry

    def write_ended(self, *, also_open: bool = False) -> None:
        """Writes the numbers of the kinds whose minute is over.

        :param also_open: the others as well, as they are now.
        """
        for kind, counted in list(self._counted.items()):
            if also_open or self._clock() - counted.begin >= _PERIOD:
                del self._counted[kind]
                if counted.more:
                    outcome = f"{counted.last['outcome']} ({counted.more} more in {_PERIOD:g} s)"
                    self._write({**counted.last, "outcome": outcome})
