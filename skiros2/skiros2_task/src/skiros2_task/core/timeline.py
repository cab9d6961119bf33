"""Facts and times while steps are added to a plan, each at the earliest; steps can be tried and taken back."""

from __future__ import annotations

from collections.abc import Iterable, MutableMapping
from typing import Any

from skiros2_task.core.ground_actions import Fact, FactLiteral, Grounded, Need

_MISSING = object()


class Timeline:
    """What holds after the steps so far, and when each step ends that the next ones have to wait for.

    A step waits for the same as in `partial_order`: those that make what it needs, that need or make what it spoils,
    that lock a device, and the one before it of its robot.
    """

    def __init__(self, init: frozenset[Fact], indexed: Iterable[tuple[int, int]]) -> None:
        """
        :param indexed: the predicates and places that `partners` will be asked for.
        """
        self._init = init
        self._indexed: dict[int, list[int]] = {}
        for number, place in indexed:
            self._indexed.setdefault(number, []).append(place)
        self.reset()

    def reset(self) -> None:
        """Forgets all steps."""
        self._now: dict[Fact, bool] = {}
        self._since: dict[Fact, float] = {}  # when the step ended that made the fact what it is
        self._written: dict[FactLiteral, float] = {}  # when the last step ended that made it so
        self._needed: dict[FactLiteral, float] = {}  # when the last step ended that needed it so
        self._free: dict[str, float] = {}  # when the last step of a robot ended
        self._undo: list[tuple[MutableMapping[Any, Any], Any, Any]] = []
        #: What the steps since the last commit need and change.
        self._added: list[tuple[Iterable[FactLiteral], ...]] = []
        self._partners: dict[tuple[int | str, int, int | str], dict[Fact, bool]] = {}
        for fact in sorted(fact for fact in self._init if fact[0] in self._indexed):
            self._note(fact, True)
        self.commit()

    def holds(self, fact: Fact) -> bool:
        known = self._now.get(fact)
        return fact in self._init if known is None else known

    def partners(self, number: int, place: int, term: str) -> list[Fact]:
        """The facts of a predicate that hold of a term at a place."""
        return [fact for fact, there in self._partners.get((number, place, term), {}).items() if there]

    def free(self, robot: str) -> float:
        """When a robot has ended its last step (s)."""
        return self._free.get(robot, 0.0)

    def add(self, step: Grounded, robot: str, seconds: float) -> bool:
        """Does a step at the earliest. False, and nothing is done, when it cannot be done now."""
        now, init = self._now, self._init
        for fact, state in step.needs:
            known = now.get(fact)
            if (fact in init if known is None else known) != state:
                return False
        needs: Iterable[FactLiteral] = step.needs
        for choice in step.choices:
            chosen = self._support(choice, step.values)
            if chosen is None:
                return False
            needs = (*needs, *chosen)
        since, written, needed = self._since, self._written, self._needed
        start = self.free(robot)
        for fact, _ in needs:
            start = max(start, since.get(fact, 0.0))
        touched = (*step.changes, *step.during)
        for fact, state in touched:
            spoilt = fact, not state
            start = max(start, written.get(spoilt, 0.0), needed.get(spoilt, 0.0))
        end = start + seconds
        undo = self._undo
        for where, literals in ((needed, needs), (written, touched)):
            for literal in literals:
                before = where.get(literal, 0.0)
                if end > before:
                    undo.append((where, literal, before))
                    where[literal] = end
        for fact, _ in step.during:
            self._set(since, fact, end)
        for fact, state in step.changes:
            if self.holds(fact) != state:
                self._set(now, fact, state)
                self._set(since, fact, end)
                if fact[0] in self._indexed:
                    self._note(fact, state)
        self._set(self._free, robot, end)
        self._added.append((needs, touched))
        return True

    @property
    def used(self) -> set[Fact]:
        """The facts that the steps since the last commit need and change."""
        return {fact for step in self._added for literals in step for fact, _ in literals}

    def commit(self) -> None:
        """Keeps the steps since the last commit."""
        self._undo.clear()
        self._added.clear()

    def take_back(self) -> None:
        """Forgets the steps since the last commit."""
        while self._undo:
            where, key, old = self._undo.pop()
            if old is _MISSING:
                del where[key]
            else:
                where[key] = old
        self._added.clear()

    def _set(self, where: MutableMapping[Any, Any], key: Any, value: Any) -> None:
        self._undo.append((where, key, where.get(key, _MISSING)))
        where[key] = value

    def _note(self, fact: Fact, state: bool) -> None:
        for place in self._indexed[fact[0]]:  # type: ignore[index]
            partners = self._partners.setdefault((fact[0], place, fact[place + 1]), {})
            if state:
                self._set(partners, fact, True)
            elif fact in partners:
                self._undo.append((partners, fact, partners.pop(fact)))

    def _support(self, need: Need, values: tuple[str, ...]) -> list[FactLiteral] | None:
        """Literals that satisfy a need now; None: it is not satisfied."""
        if need.pattern is not None:
            fact = need.pattern.fact(values)
            return [(fact, need.state)] if self.holds(fact) == need.state else None
        parts = [self._support(part, values) for part in need.parts]
        there = [literals for literals in parts if literals is not None]
        if need.state:
            return [literal for part in there for literal in part] if len(there) == len(parts) else None
        return min(there, key=lambda part: max((self._since.get(f, 0.0) for f, _ in part), default=0.0), default=None)
