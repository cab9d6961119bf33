"""Who may use which robots and devices, where several goals are carried out at once."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count


@dataclass
class _Claim:
    """What one goal has, and what it waits for.

    :param turn: among claims of one priority, the one that began to wait first goes first.
    """

    priority: int
    turn: int
    held: frozenset[str] = frozenset()
    wanted: frozenset[str] = frozenset()


class Claims:
    """Robots and devices, by any names, each held by one goal at most.

    A goal gets all that it wants at once or waits, and what it does not use it gives back while it waits: so no two
    goals wait for each other. Of those that want the same, the one with the higher priority gets it first.
    """

    def __init__(self) -> None:
        self._claims: dict[str, _Claim] = {}
        self._turns = count()

    def want(self, owner: str, priority: int, wanted: frozenset[str], in_use: frozenset[str]) -> list[str]:
        """States what a goal wants from now on, in the place of what it wanted before. Returns who has by that got all
        that they want: other goals that waited, and this one where it need not wait.

        :param in_use: what the goal is using, and so keeps while it waits.
        """
        claim = self._claims.setdefault(owner, _Claim(priority, next(self._turns)))
        claim.wanted = wanted | in_use
        claim.held &= claim.wanted if claim.wanted <= claim.held else in_use
        had_all = claim.wanted <= claim.held
        served = self._serve()
        return [owner, *served] if had_all else served

    def drop(self, owner: str) -> list[str]:
        """Gives back all that a goal has. Returns who is served by that."""
        self._claims.pop(owner, None)
        return self._serve()

    def held_by_others(self, owner: str) -> frozenset[str]:
        """What other goals have."""
        return frozenset(name for other, c in self._claims.items() if other != owner for name in c.held)

    def _serve(self) -> list[str]:
        """Gives what is free to those that wait, the most urgent first; nobody is overtaken by what wants the same."""
        served = []
        taken = {name for claim in self._claims.values() for name in claim.held}
        for owner, claim in sorted(self._claims.items(), key=lambda item: (-item[1].priority, item[1].turn)):
            missing = claim.wanted - claim.held
            if missing and not missing & taken:
                claim.held = claim.wanted
                served.append(owner)
            taken |= missing
        return served
