"""Robots and devices, which goals hold while they use them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count


@dataclass
class _Holding:
    """The resources that a goal holds and requests.

    :param turn: orders the claims of one priority, first come, first served.
    """

    priority: int
    turn: int
    held: frozenset[str] = frozenset()
    requested: frozenset[str] = frozenset()


class Resources:
    """Robots and devices, by name, each held by at most one goal.

    A goal is granted everything it requests at once, or waits. While it waits, it releases what it does not use, so
    goals cannot deadlock. Of goals that request the same resource, the one with the highest priority gets it first.
    """

    def __init__(self) -> None:
        self._claims: dict[str, _Holding] = {}
        self._turns = count()

    def request(self, owner: str, priority: int, requested: frozenset[str], in_use: frozenset[str]) -> list[str]:
        """Replaces the request of a goal.

        :param in_use: the resources that the goal is using, which it keeps while it waits.
        :returns: the goals that now hold everything they request: this one, unless it has to wait, and others that
            waited.
        """
        claim = self._claims.setdefault(owner, _Holding(priority, next(self._turns)))
        claim.requested = requested | in_use
        claim.held &= claim.requested if claim.requested <= claim.held else in_use
        had_all = claim.requested <= claim.held
        granted = self._grant()
        return [owner, *granted] if had_all else granted

    def release(self, owner: str) -> list[str]:
        """Releases all resources of a goal. Returns the waiting goals that are granted theirs."""
        self._claims.pop(owner, None)
        return self._grant()

    def held_by_others(self, owner: str) -> frozenset[str]:
        """Returns the resources that other goals hold."""
        return frozenset(name for other, c in self._claims.items() if other != owner for name in c.held)

    def lower_holders(self, owner: str) -> dict[str, frozenset[str]]:
        """Returns what a goal waits for and goals with a lower priority hold, by goal."""
        waiting = self._claims[owner]
        missing = waiting.requested - waiting.held
        lower = {name: c.held & missing for name, c in self._claims.items() if c.priority < waiting.priority}
        return {name: held for name, held in lower.items() if held}

    def _grant(self) -> list[str]:
        """Grants requests by priority. A resource that a goal waits for is not granted to a goal of lower priority."""
        granted = []
        taken = {name for claim in self._claims.values() for name in claim.held}
        for owner, claim in sorted(self._claims.items(), key=lambda item: (-item[1].priority, item[1].turn)):
            missing = claim.requested - claim.held
            if missing and not missing & taken:
                claim.held = claim.requested
                granted.append(owner)
            taken |= missing
        return granted
