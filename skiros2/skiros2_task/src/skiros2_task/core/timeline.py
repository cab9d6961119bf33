"""Facts and times while steps are added to a schedule, each as early as possible, with commit and rollback."""

from __future__ import annotations

from collections.abc import Iterable, MutableMapping
from typing import Any

from skiros2_task.core.ground_actions import Fact, FactLiteral, Grounded, Need

_MISSING = object()


class Timeline:
    """The facts after the added steps, and the times that constrain further steps.

    The constraints are those of `partial_order`: a step starts after the producers of its facts, after the consumers
    and producers of facts that it deletes, after steps that lock the same device, and after its robot's last step.
    """

    def __init__(self, init: frozenset[Fact], indexed: Iterable[tuple[int, int]]) -> None:
        """
        :param indexed: the (predicate, position) pairs that `facts_with` supports.
        """
        self._init = init
        self._indexed: dict[int, list[int]] = {}
        for number, position in indexed:
            self._indexed.setdefault(number, []).append(position)
        self.reset()

    def reset(self) -> None:
        """Removes all steps."""
        self._now: dict[Fact, bool] = {}
        self._since: dict[Fact, float] = {}  # the end of the step that gave the fact its current value
        self._written: dict[FactLiteral, float] = {}  # the end of the last step with this effect
        self._needed: dict[FactLiteral, float] = {}  # the end of the last step with this precondition
        self._free: dict[str, float] = {}  # the end of each robot's last step
        self._undo: list[tuple[MutableMapping[Any, Any], Any, Any]] = []
        #: The preconditions and effects of the steps since the last commit.
        self._added: list[tuple[Iterable[FactLiteral], ...]] = []
        self._index: dict[tuple[int | str, int, int | str], dict[Fact, bool]] = {}
        for fact in sorted(fact for fact in self._init if fact[0] in self._indexed):
            self._update_index(fact, True)
        self.commit()

    def holds(self, fact: Fact) -> bool:
        known = self._now.get(fact)
        return fact in self._init if known is None else known

    def facts_with(self, number: int, position: int, term: str) -> list[Fact]:
        """Returns the current facts of a predicate that have a term at a position."""
        return [fact for fact, is_current in self._index.get((number, position, term), {}).items() if is_current]

    def free_at(self, robot: str) -> float:
        """Returns when a robot's last step ends (s)."""
        return self._free.get(robot, 0.0)

    def add(self, step: Grounded, robot: str, seconds: float) -> bool:
        """Adds a step at the earliest time. Returns False, and adds nothing, if it is not applicable."""
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
        start = self.free_at(robot)
        for fact, _ in needs:
            start = max(start, since.get(fact, 0.0))
        changes = (*step.changes, *step.during)
        for fact, state in changes:
            deleted = fact, not state
            start = max(start, written.get(deleted, 0.0), needed.get(deleted, 0.0))
        end = start + seconds
        undo = self._undo
        for times, literals in ((needed, needs), (written, changes)):
            for literal in literals:
                before = times.get(literal, 0.0)
                if end > before:
                    undo.append((times, literal, before))
                    times[literal] = end
        for fact, _ in step.during:
            self._set(since, fact, end)
        for fact, state in step.changes:
            if self.holds(fact) != state:
                self._set(now, fact, state)
                self._set(since, fact, end)
                if fact[0] in self._indexed:
                    self._update_index(fact, state)
        self._set(self._free, robot, end)
        self._added.append((needs, changes))
        return True

    @property
    def used(self) -> set[Fact]:
        """The facts that the steps since the last commit need or change."""
        return {fact for step in self._added for literals in step for fact, _ in literals}

    def commit(self) -> None:
        """Keeps the steps since the last commit."""
        self._undo.clear()
        self._added.clear()

    def rollback(self) -> None:
        """Removes the steps since the last commit."""
        while self._undo:
            mapping, key, old = self._undo.pop()
            if old is _MISSING:
                del mapping[key]
            else:
                mapping[key] = old
        self._added.clear()

    def _set(self, mapping: MutableMapping[Any, Any], key: Any, value: Any) -> None:
        self._undo.append((mapping, key, mapping.get(key, _MISSING)))
        mapping[key] = value

    def _update_index(self, fact: Fact, state: bool) -> None:
        for position in self._indexed[fact[0]]:  # type: ignore[index]
            facts = self._index.setdefault((fact[0], position, fact[position + 1]), {})
            if state:
                self._set(facts, fact, True)
            elif fact in facts:
                self._undo.append((facts, fact, facts.pop(fact)))

    def _support(self, need: Need, values: tuple[str, ...]) -> list[FactLiteral] | None:
        """Returns literals that satisfy a need now; None if it is not satisfied."""
        if need.pattern is not None:
            fact = need.pattern.fact(values)
            return [(fact, need.state)] if self.holds(fact) == need.state else None
        parts = [self._support(part, values) for part in need.parts]
        found = [literals for literals in parts if literals is not None]
        if need.state:
            return [literal for part in found for literal in part] if len(found) == len(parts) else None
        return min(found, key=lambda part: max((self._since.get(f, 0.0) for f, _ in part), default=0.0), default=None)
