"""Why a search for elements found none: how many candidates each condition left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import islice
from typing import Any

from skiros2_common.core.explanation import MAX_EXAMPLES, FilterStep, InferenceFailure, NearMatch
from skiros2_common.core.names import ANY_TYPE
from skiros2_common.core.world_element import Element
from skiros2_skill.core.inference import Search

#: Of so many candidates, the first, it is looked which comes nearest.
MOST_COMPARED = 100

#: A condition on two unset parameters that no index answers is counted when there are no more pairs.
MOST_PAIRS = 20_000


def candidates_of(search: Search) -> list[InferenceFailure]:
    """What the scene had for each of the parameters that a search found nothing for.

    Counted are first the conditions on one parameter alone. When these leave some for each, those on two: what
    remains of the candidates of one that some candidate of the other fits.
    """
    domains = {key: _Domain(search, key) for key in search.failed}
    for domain in domains.values():
        for condition in _of(search, {domain.key}):
            domain.keep(list(filter(_check(search, condition, domain.key), domain.left)), condition)
    _count_pairs(search, domains)
    return [domain.candidates for domain in domains.values()]


def told(search: Search, candidates: list[InferenceFailure]) -> str:
    """Why there is nothing, in one line."""
    emptied = [str(c) for c in candidates if c.emptied]
    if emptied:
        return "; ".join(emptied)
    counts = [f"{c.left[-1].count if c.left else c.total} {c.wanted} for {c.key!r}" for c in candidates]
    joint = [c.label for c in search.conditions if len(search.patterns.keys() & c.getKeys()) > 1]
    return f"no combination of {', '.join(counts)} fits {', '.join(f'[{label}]' for label in joint)}"


class _Domain:
    """The candidates of one parameter, as conditions leave them."""

    def __init__(self, search: Search, key: str) -> None:
        self.key = key
        self.left = search.like(key)
        pattern = search.patterns[key]
        kind = "element" if pattern.type in ANY_TYPE else pattern.type
        label = f" {pattern.label!r}" if pattern.label else ""
        self.candidates = InferenceFailure(key, f"{kind}{label}", len(self.left))
        self._search = search

    def keep(self, left: list[Element], condition: Any) -> None:
        """What a condition has left. Once nothing is left, nothing more is counted."""
        if not self.left:
            return
        phrase = condition.filter_text(self.key, self._search.params)
        self.candidates.left.append(FilterStep(phrase, len(left), condition.label))
        if not left:
            self.candidates.nearest = list(islice(self._nearest(condition), MAX_EXAMPLES))
        self.left = left

    def _nearest(self, emptying: Any) -> Iterator[NearMatch]:
        """Of those left before, the ones that most conditions hold of."""
        search, key = self._search, self.key
        alone = _of(search, {key})
        checks = [_check(search, c, key) for c in alone]

        def fitting(element: Element) -> int:
            return sum(check(element) for check in checks)

        for element in sorted(self.left[:MOST_COMPARED], key=fitting, reverse=True):
            why = ""
            if emptying in alone:
                with search.tried(key, element):
                    emptying.evaluate(search.params, search.wmi)
                    why = emptying.found_for(key, search.params, search.wmi)
            yield NearMatch(repr(element), why)


def _of(search: Search, keys: set[str]) -> list[Any]:
    """The conditions that speak of just these of the unset parameters."""
    return [c for c in search.conditions if search.patterns.keys() & c.getKeys() == keys]


def _check(search: Search, condition: Any, key: str) -> Callable[[Element], bool]:
    """Tells of which elements a condition on one unset parameter holds."""
    ids = search.linked(condition, key) if search.is_link(condition) else None
    if ids is not None:
        return lambda element: element.id in ids
    return lambda element: search.fits(condition, key, element)


def _count_pairs(search: Search, domains: dict[str, _Domain]) -> None:
    """Keeps the candidates for which each condition on two parameters has a fitting one, until nothing changes."""
    pairs = [(c, one, other) for one in domains for other in domains if one != other for c in _of(search, {one, other})]
    changed = True
    while changed and all(domain.left for domain in domains.values()):
        changed = False
        for condition, one, other in pairs:
            kept = _supported(search, condition, domains[one], domains[other])
            if len(kept) < len(domains[one].left):
                domains[one].keep(kept, condition)
                changed = True


def _supported(search: Search, condition: Any, one: _Domain, other: _Domain) -> list[Element]:
    """The candidates of one parameter with which a condition holds for some candidate of the other."""
    is_link = search.is_link(condition)
    if not is_link and len(one.left) * len(other.left) > MOST_PAIRS:
        return one.left
    ids = {e.id for e in other.left}
    kept = []
    for element in one.left:
        with search.tried(one.key, element):
            if is_link:
                fits = not ids.isdisjoint(search.linked(condition, other.key) or ())
            else:
                fits = any(search.holds(condition, other.key, e) for e in other.left)
        if fits:
            kept.append(element)
    return kept
