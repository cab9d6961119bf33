"""Finds facts that the steps of a goal have changed though the descriptions of their skills do not declare it."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from skiros2_common.core.operations import Change
from skiros2_common.core.world_model_port import changed_ids
from skiros2_task.core.formula import Atom, Kind
from skiros2_task.core.plan import Step
from skiros2_task.core.semantics import Facts
from skiros2_task.core.step_record import StepRecord

#: The kinds of facts that skills can change.
_CHANGEABLE = (Kind.RELATION, Kind.VALUE, Kind.COMPARES, Kind.HAS)

#: The number of changes of the world model that are kept.
_MAX_CHANGES = 1000


@dataclass(frozen=True)
class UndeclaredChange:
    """A fact that a step has changed without declaring it.

    :param holds: whether the fact holds now.
    :param stamp: the time of the change (s since the epoch).
    """

    step: Step
    atom: Atom
    holds: bool
    stamp: float

    def __str__(self) -> str:
        at = time.strftime("%H:%M:%S", time.localtime(self.stamp))
        made = "true" if self.holds else "false"
        undeclared = f"the description of {self.step.call.type} does not declare it"
        return f"{self.step} made {self.atom} {made} at {at}; {undeclared}"


class UndeclaredChanges:
    """The undeclared changes of one goal's steps. Not thread-safe.

    The step of a change is the one that its author, a skill manager, ran at that time.

    :param clock: that of the steps' records (s).
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._changes: deque[tuple[float, Change]] = deque(maxlen=_MAX_CHANGES)
        # The times of the last two comparisons: facts may be read just before a change, and compared just after it.
        self._last = self._before_last = -math.inf
        self._found: dict[Atom, UndeclaredChange] = {}

    def __str__(self) -> str:
        return "\n".join(map(str, self._found.values()))

    def add(self, change: Change) -> None:
        """Records a change of the world model, with its time by this clock."""
        self._changes.append((self._clock() - max(0.0, time.time() - change.stamp), change))

    def compare(self, expected: Facts, facts: Facts, records: Iterable[StepRecord]) -> list[UndeclaredChange]:
        """Returns new undeclared changes.

        :param expected: the facts as the steps declare them.
        :param facts: those of the world model.
        """
        started = (r for r in records if r.started is not None)
        recent = [r for r in started if r.ended is None or r.ended >= self._before_last]
        declared = {atom for record in recent for atom, _ in record.step.ground.changes}
        self._before_last, self._last = self._last, self._clock()
        new = []
        for atom in sorted((expected ^ facts) - declared, key=str):
            cause = self._cause(atom, recent) if atom.predicate.kind in _CHANGEABLE else None
            before = self._found.pop(atom, None)
            if cause is None or (before is not None and before.step.number == cause[0].number):
                continue  # changed by others, or restored by the step
            self._found[atom] = UndeclaredChange(cause[0], atom, atom in facts, cause[1])
            new.append(self._found[atom])
        return new

    def _cause(self, atom: Atom, recent: list[StepRecord]) -> tuple[Step, float] | None:
        """Returns the step that was the last to change an element of the fact, and when; None if it was not a step."""
        for at, change in reversed(self._changes):
            if changed_ids(change) & set(atom.terms):
                ran = [r for r in recent if r.step.call.manager == change.author and (r.started or 0.0) <= at]
                return (max(ran, key=lambda r: r.started or 0.0).step, change.stamp) if ran else None
        return None
