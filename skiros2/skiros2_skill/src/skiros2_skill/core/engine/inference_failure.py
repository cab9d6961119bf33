"""Explains why inference found no elements: how many candidates remained after each condition."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.explanation import MAX_EXAMPLES, FilterStep, InferenceFailure, NearMatch
from skiros2_common.core.names import ANY_TYPE
from skiros2_common.core.world_element import Element
from skiros2_skill.core.engine.inference import Search

#: How many candidates are compared to find near matches.
MAX_COMPARED = 100

#: Maximum number of pairs for which a condition on two parameters without an index is evaluated.
MAX_PAIRS = 20_000


def filter_candidates(search: Search) -> list[InferenceFailure]:
    """The candidates of each parameter without a value, and the number that remains after each filter step.

    The conditions on one parameter are applied first. If candidates remain for all parameters, the conditions on two
    parameters follow: a candidate of one remains if some candidate of the other satisfies the condition with it.
    """
    domains = {key: _Domain(search, key) for key in search.failed}
    for domain in domains.values():
        for condition in _conditions_on(search, {domain.key}):
            domain.apply(condition, list(filter(_check(search, condition, domain.key), domain.remaining)))
    _filter_pairs(search, domains)
    return [domain.candidates for domain in domains.values()]


def failure_text(search: Search, candidates: list[InferenceFailure]) -> str:
    """Why the search failed, in one line."""
    emptied = [str(c) for c in candidates if c.emptied]
    if emptied:
        return "; ".join(emptied)
    counts = [f"{c.left[-1].count if c.left else c.total} {c.wanted} for {c.key!r}" for c in candidates]
    joint = [c.label for c in search.conditions if len(search.patterns.keys() & c.getKeys()) > 1]
    return f"no combination of {', '.join(counts)} fits {', '.join(f'[{label}]' for label in joint)}"


class _Domain:
    """The remaining candidates of one parameter."""

    def __init__(self, search: Search, key: str) -> None:
        self.key = key
        self.remaining = search.matching(key)
        pattern = search.patterns[key]
        kind = "element" if pattern.type in ANY_TYPE else pattern.type
        label = f" {pattern.label!r}" if pattern.label else ""
        self.candidates = InferenceFailure(key, f"{kind}{label}", len(self.remaining))
        self._search = search

    def apply(self, condition: ConditionBase, remaining: list[Element]) -> None:
        """Records a filter step: the candidates that satisfy a condition. Does nothing when none remained before."""
        if not self.remaining:
            return
        phrase = condition.filter_text(self.key, self._search.params)
        self.candidates.left.append(FilterStep(phrase, len(remaining), condition.label))
        if not remaining:
            self.candidates.nearest = list(islice(self._nearest(condition), MAX_EXAMPLES))
        self.remaining = remaining

    def _nearest(self, emptying: ConditionBase) -> Iterator[NearMatch]:
        """NearMatch matches: of the candidates before the last step, those that satisfy most conditions."""
        search, key = self._search, self.key
        alone = _conditions_on(search, {key})
        checks = [_check(search, c, key) for c in alone]

        def satisfied(element: Element) -> int:
            return sum(check(element) for check in checks)

        for element in sorted(self.remaining[:MAX_COMPARED], key=satisfied, reverse=True):
            why = ""
            if emptying in alone:
                with search.assuming(key, element):
                    emptying.evaluate(search.params, search.wmi)
                    why = emptying.found_for(key, search.params, search.wmi)
            yield NearMatch(repr(element), why)


def _conditions_on(search: Search, keys: set[str]) -> list[ConditionBase]:
    """The conditions that refer to exactly these unset parameters."""
    return [c for c in search.conditions if search.patterns.keys() & c.getKeys() == keys]


def _check(search: Search, condition: ConditionBase, key: str) -> Callable[[Element], bool]:
    """A predicate: whether an element satisfies a condition on one unset parameter."""
    ids = search.linked(condition, key)
    if ids is not None:
        return lambda element: element.id in ids
    return lambda element: search.satisfies(condition, key, element)


def _filter_pairs(search: Search, domains: dict[str, _Domain]) -> None:
    """Applies the conditions on two parameters until nothing changes (arc consistency)."""
    pairs = [
        (condition, one, other)
        for one in domains
        for other in domains
        if one != other
        for condition in _conditions_on(search, {one, other})
    ]
    changed = True
    while changed and all(domain.remaining for domain in domains.values()):
        changed = False
        for condition, one, other in pairs:
            supported = _supported(search, condition, domains[one], domains[other])
            if len(supported) < len(domains[one].remaining):
                domains[one].apply(condition, supported)
                changed = True


def _supported(search: Search, condition: ConditionBase, one: _Domain, other: _Domain) -> list[Element]:
    """The candidates of one parameter that satisfy a condition together with some candidate of the other."""
    ids = {e.id for e in other.remaining}
    supported = []
    for element in one.remaining:
        with search.assuming(one.key, element):
            linked = search.linked(condition, other.key)
            if linked is not None:
                holds = not ids.isdisjoint(linked)
            elif len(one.remaining) * len(other.remaining) > MAX_PAIRS:
                return one.remaining
            else:
                holds = any(search.holds(condition, other.key, e) for e in other.remaining)
        if holds:
            supported.append(element)
    return supported
