"""Facts and times while steps are added to a schedule, each as early as possible, with commit and rollback."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from skiros2_task.core.formula import Atom, Predicate
from skiros2_task.core.semantics import Facts, GroundStep, Literal, support

_MISSING = object()


class Timeline:
    """The facts after the added steps, and the times that constrain further steps.

    The constraints are those of `partial_order`: a step starts after the producers of its facts, after the consumers
    and producers of facts that it deletes, after steps that lock the same device, and after its robot's last step.
    """

    def __init__(self, init: Facts, indexed: Iterable[tuple[Predicate, int]]) -> None:
        """
        :param indexed: the (predicate, position) pairs that `facts_with` supports.
        """
        self._init = init
        self._indexed: dict[Predicate, list[int]] = {}
        for predicate, position in indexed:
            self._indexed.setdefault(predicate, []).append(position)
        self._start = sorted(atom for atom in init if atom.predicate in self._indexed)
        self.reset()

    def reset(self) -> None:
        """Removes all steps."""
        self._now: dict[Atom, bool] = {}
        self._since: dict[Atom, float] = {}  # the end of the step that gave the fact its current value
        #: The end of the last step with this effect, and with this precondition, by the value of the fact.
        self._written: tuple[dict[Atom, float], dict[Atom, float]] = {}, {}
        self._needed: tuple[dict[Atom, float], dict[Atom, float]] = {}, {}
        self._free: dict[str, float] = {}  # the end of each robot's last step
        self._undo: list[tuple[dict[Any, Any], object, object]] = []  # changed entries of the mappings above
        self._added: list[GroundStep] = []  # since the last commit
        self._index: dict[tuple[Predicate, int, str], dict[Atom, bool]] = {}
        for atom in self._start:
            self._update_index(atom, True)
        self.commit()

    def holds(self, atom: Atom) -> bool:
        known = self._now.get(atom)
        return atom in self._init if known is None else known

    def facts_with(self, predicate: Predicate, position: int, term: str) -> list[Atom]:
        """Returns the current facts of a predicate that have a term at a position."""
        return [atom for atom, is_current in self._index.get((predicate, position, term), {}).items() if is_current]

    def free_at(self, robot: str) -> float:
        """Returns when a robot's last step ends (s)."""
        return self._free.get(robot, 0.0)

    def add(self, step: GroundStep, seconds: float) -> bool:
        """Adds a step at the earliest time. Returns False, and adds nothing, if it cannot start."""
        now, init, since = self._now, self._init, self._since
        for atom, state in step.needs:
            known = now.get(atom)
            if (atom in init if known is None else known) != state:
                return False
        needs: Iterable[Literal] = step.needs
        for choice in step.choices:
            chosen = support(choice, self.holds, self._held_since)
            if chosen is None:
                return False
            needs = (*needs, *chosen)
        written, needed = self._written, self._needed
        start = self.free_at(step.robot)
        for atom, _ in needs:
            start = max(start, since.get(atom, 0.0))
        changes = step.changes
        for atom, state in changes:
            start = max(start, written[not state].get(atom, 0.0), needed[not state].get(atom, 0.0))
        end = start + seconds
        undo = self._undo
        for both, literals in ((needed, needs), (written, changes)):
            for atom, state in literals:
                times = both[state]
                before = times.get(atom, 0.0)
                if end > before:
                    undo.append((times, atom, before))
                    times[atom] = end
        for atom in step.during:
            self._set(since, atom, end)
        for atom, state in step.effects.items():
            if self.holds(atom) != state:
                self._set(now, atom, state)
                self._set(since, atom, end)
                if atom.predicate in self._indexed:
                    self._update_index(atom, state)
        self._set(self._free, step.robot, end)
        self._added.append(step)
        return True

    @property
    def used(self) -> set[Atom]:
        """The facts that the steps since the last commit need or change."""
        return {atom for s in self._added for atoms in (s.needed_atoms, s.effects, s.during) for atom in atoms}

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

    def _held_since(self, atom: Atom) -> float:
        return self._since.get(atom, 0.0)

    def _set(self, mapping: dict[Any, Any], key: object, value: object) -> None:
        self._undo.append((mapping, key, mapping.get(key, _MISSING)))
        mapping[key] = value

    def _update_index(self, atom: Atom, state: bool) -> None:
        for position in self._indexed[atom.predicate]:
            facts = self._index.setdefault((atom.predicate, position, atom.terms[position]), {})
            if state:
                self._set(facts, atom, True)
            elif atom in facts:
                self._undo.append((facts, atom, facts.pop(atom)))
