"""Finding elements for unset parameters, so that all pre-conditions that speak of them hold.

A constraint search with backtracking: the parameter with the fewest candidates is bound first, and a condition is
checked as soon as all its keys are bound. Candidates are tried preferred ones first, then ordered by id, so that the
same scene gives the same answer.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from skiros2_common.core.conditions import ConditionRelation
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element

_NUMBER = re.compile(r"(\d+)$")


@dataclass(frozen=True)
class Nothing:
    """Why no elements were found: the parameter whose candidates ran out, and the condition that ruled out the last."""

    key: str
    wanted: str
    candidates: int
    condition: Any = None

    def __str__(self) -> str:
        if not self.candidates:
            return f"no {self.wanted} in the scene for parameter {self.key!r}"
        blamed = f": {self.condition.getDescription()} does not hold" if self.condition is not None else ""
        return f"none of {self.candidates} {self.wanted} fits parameter {self.key!r}{blamed}"


def infer(params: ParamHandler, conditions: Sequence[Any], wmi: Any, preferred: Collection[str] = ()) -> Nothing | None:
    """Sets the unset Required and Inferred element parameters. Returns why that is not possible, None when it was.

    An Inferred parameter that no condition speaks of, and that no element of the scene fits, stays unset.

    :param conditions: the pre-conditions.
    :param preferred: ids of elements to try first.
    """
    search = _Search(params, conditions, wmi, preferred)
    return search.run()


def inferable(params: ParamHandler) -> list[Param]:
    """The parameters that have to be found: Required or Inferred, of element type, unset."""
    return [
        p
        for p in params.values()
        if p.is_element and not p.isSpecified() and p.paramType in (ParamTypes.Required, ParamTypes.Inferred)
    ]


class _Search:
    def __init__(self, params: ParamHandler, conditions: Sequence[Any], wmi: Any, preferred: Collection[str]) -> None:
        self._params = params
        self._wmi = wmi
        self._preferred = preferred
        self._patterns = {p.key: p.value or p.default or Element("") for p in inferable(params)}
        self._conditions = [c for c in conditions if any(key in self._patterns for key in c.getKeys())]
        self._resolved: dict[str, list[Element]] = {}
        self._nothing: Nothing | None = None

    def run(self) -> Nothing | None:
        mentioned = {key for c in self._conditions for key in c.getKeys()}
        for key in list(self._patterns):
            param = self._params.getParamMap()[key]
            if key not in mentioned and param.paramTypeIs(ParamTypes.Inferred) and not self._of_type(key):
                del self._patterns[key]
        if not self._patterns or self._bind(set(self._patterns)):
            return None
        for key in self._patterns:
            self._params.getParamMap()[key].setDefault()
        return self._nothing

    def _bind(self, unbound: set[str]) -> bool:
        if not unbound:
            return True
        key, candidates = self._most_constrained(unbound)
        param = self._params.getParamMap()[key]
        rest = unbound - {key}
        checks = [c for c in self._conditions if key in c.getKeys() and not rest.intersection(c.getKeys())]
        blamed = None
        before = list(param.values)
        for candidate in candidates:
            param.assign(candidate)
            blamed = next((c for c in checks if not c.evaluate(self._params, self._wmi)), None)
            if blamed is None and self._bind(rest):
                return True
        param.assign(before)
        if self._nothing is None or blamed is not None or not candidates:
            wanted = self._patterns[key].type or "element"
            self._nothing = Nothing(key, wanted, len(candidates) or len(self._of_type(key)), blamed)
        return False

    def _most_constrained(self, unbound: set[str]) -> tuple[str, list[Element]]:
        best: tuple[str, list[Element]] | None = None
        for key in self._patterns:
            if key not in unbound:
                continue
            candidates = self._candidates(key, unbound)
            if best is None or len(candidates) < len(best[1]):
                best = (key, candidates)
        assert best is not None
        return best[0], sorted(best[1], key=self._order)

    def _candidates(self, key: str, unbound: set[str]) -> list[Element]:
        """What the scene has for a parameter, given what is bound so far."""
        related: set[str] | None = None
        for condition in self._conditions:
            ids = self._related(condition, key, unbound)
            if ids is not None:
                related = ids if related is None else related & ids
        if related is None:
            return self._of_type(key)
        found = (self._wmi.find_element(eid) for eid in related)
        pattern = self._patterns[key]
        return [e for e in found if e is not None and (not pattern.type or e.isInstance(pattern, self._wmi))]

    def _related(self, condition: Any, key: str, unbound: set[str]) -> set[str] | None:
        """The ids that a relation to an element that is bound leaves for a parameter; None when it says nothing."""
        if type(condition) is not ConditionRelation or not condition.desired_state:
            return None
        is_subject = condition.subject_key == key
        other_key = condition.object_key if is_subject else condition.subject_key
        if key not in condition.getKeys() or other_key == key or other_key in unbound:
            return None
        other = self._params.getParamMap().get(other_key)
        if other is None or not other.isSpecified() or self._wmi.get_reasoner(condition.relation) is not None:
            return None
        if is_subject:
            return {r["src"] for r in self._wmi.get_relations("", condition.relation, other.value.id)}
        return {r["dst"] for r in self._wmi.get_relations(other.value.id, condition.relation, "")}

    def _of_type(self, key: str) -> list[Element]:
        if key not in self._resolved:
            self._resolved[key] = list(self._wmi.resolve_elements(self._patterns[key]))
        return self._resolved[key]

    def _order(self, element: Element) -> tuple[bool, str, int]:
        number = _NUMBER.search(element.id)
        return (
            element.id not in self._preferred,
            element.id[: number.start()] if number else element.id,
            int(number.group(1)) if number else -1,
        )
