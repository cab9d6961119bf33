"""Infers elements for unset parameters so that all pre-conditions on them hold.

A constraint search with backtracking. Parameters that share no condition are searched independently. The parameter with
the fewest candidates is bound first. Candidates come from an index where a relation to a bound element, or a required
property value, constrains them. A condition is checked as soon as all its keys are bound, those of reasoners last.
Candidates are tried in the order: preferred ones, then by id. The same scene gives the same result.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice

from skiros2_common.core.condition import ConditionBase
from skiros2_common.core.condition_record import Cost
from skiros2_common.core.explanation import MAX_EXAMPLES, FilterStep, InferenceFailure, NearMatch
from skiros2_common.core.names import ANY_TYPE, id_order
from skiros2_common.core.params import Param, ParamHandler, ParamTypes
from skiros2_common.core.world_element import Element
from skiros2_common.core.world_model_port import WorldModelPort


def inferable(params: ParamHandler) -> list[Param]:
    """The parameters to infer: Required or Inferred, of element type, unset."""
    return [
        p
        for p in params.values()
        if p.is_element and not p.is_bound() and p.paramType in (ParamTypes.Required, ParamTypes.Inferred)
    ]


def infer(
    params: ParamHandler,
    conditions: Sequence[ConditionBase],
    wmi: WorldModelPort,
    preferred: Collection[str] = (),
    first: Mapping[str, Sequence[Element]] | None = None,
) -> Search | None:
    """Sets the unset Required and Inferred element parameters.

    An Inferred parameter without conditions and candidates stays unset.

    :param conditions: the pre-conditions.
    :param preferred: ids of elements to try before others of the class.
    :param first: elements to try before all others, of any class, by key.
    :returns: None; after a failure the search, with the keys without a value in `failed`.
    """
    search = Search(params, conditions, wmi, preferred, first)
    return None if search.run() else search


class Search:
    """A search for the values of parameters.

    :param params: see `infer`; during the search they hold the values being tried.
    """

    def __init__(
        self,
        params: ParamHandler,
        conditions: Sequence[ConditionBase],
        wmi: WorldModelPort,
        preferred: Collection[str] = (),
        first: Mapping[str, Sequence[Element]] | None = None,
    ) -> None:
        self.params = params
        self.wmi = wmi
        #: The keys of the group of parameters for which the search failed.
        self.failed: list[str] = []
        #: The pattern that the element of each key has to match.
        self.patterns = {p.key: p.value or p.default or Element("") for p in inferable(params)}
        #: The conditions on unset parameters, cheap ones first.
        self.conditions = sorted(
            (c for c in conditions if not self.patterns.keys().isdisjoint(c.getKeys())), key=lambda c: c.cost
        )
        self._keys = {id(c): frozenset(c.getKeys()) for c in self.conditions}
        #: The conditions on several unset parameters.
        self._joint = {number for number, keys in self._keys.items() if len(keys & self.patterns.keys()) > 1}
        self._preferred = preferred
        self._first = first or {}
        self._known: dict[str, list[Element]] = {}
        self._verdicts: dict[tuple[int, str, str], bool] = {}

    def run(self) -> bool:
        """Sets all parameters, or none. Returns whether it succeeded."""
        for keys in self._connected_keys():
            firsts = [key for key in keys if key in self._first]
            if not self._bind_first(frozenset(keys), firsts):
                self.failed = keys
                for key in self.patterns:
                    self.params._params[key].setDefault()
                return False
        return True

    # -- conditions --------------------------------------------------------------------------------------------

    def holds(self, condition: ConditionBase, key: str, element: Element) -> bool:
        """Whether a condition holds with an element as the value of a parameter."""
        param = self.params._params[key]
        before, param.current = param.current, [element]
        try:
            return condition.satisfied_for_inference(self.params, self.wmi)
        finally:
            param.current = before

    @contextmanager
    def assuming(self, key: str, element: Element) -> Iterator[None]:
        """Sets a parameter to an element inside the `with` block."""
        param = self.params._params[key]
        before, param.current = param.current, [element]
        try:
            yield
        finally:
            param.current = before

    def _connected_keys(self) -> list[list[str]]:
        """The unset keys in groups that share conditions."""
        groups: list[list[str]] = []
        mentioned = {key for keys in self._keys.values() for key in keys}
        for key in self.patterns:
            if any(key in group for group in groups):
                continue
            is_optional = key not in mentioned and self.params._params[key].paramTypeIs(ParamTypes.Inferred)
            if is_optional and key not in self._first and not self._candidates(key):
                continue
            group = [key]
            for member in group:
                connected = {k for keys in self._keys.values() if member in keys for k in keys}
                group += [k for k in self.patterns if k in connected and k not in group]
            groups.append(group)
        return groups

    # -- the search --------------------------------------------------------------------------------------------

    def _bind_first(self, unbound: frozenset[str], firsts: list[str]) -> bool:
        """Binds as many keys as possible to their first candidates, then the other keys."""
        if not firsts:
            return self._bind(unbound)
        key, *others = firsts
        rest = unbound - {key}
        checks = [c for c in self._conditions_on(key) if rest.isdisjoint(self._keys[id(c)])]
        for candidate in self._first[key]:
            if all(self.satisfies(c, key, candidate) for c in checks):
                self.params._params[key].current = [candidate]
                if self._bind_first(rest, others):
                    return True
        return self._bind_first(unbound, others)

    def _bind(self, unbound: frozenset[str]) -> bool:
        if not unbound:
            return True
        key, candidates, applied = self._most_constrained(unbound)
        param = self.params._params[key]
        rest = unbound - {key}
        conditions = [c for c in self._conditions_on(key) if rest.isdisjoint(self._keys[id(c)])]
        checks = [c for c in conditions if not any(c is done for done in applied)]
        for candidate in candidates:
            if all(self.satisfies(c, key, candidate) for c in checks):
                param.current = [candidate]
                if self._bind(rest):
                    return True
        return False  # the parameter keeps the last value tried; nothing reads it before it is bound again

    def satisfies(self, condition: ConditionBase, key: str, candidate: Element) -> bool:
        """Same as `holds`; the result of a condition on one unset parameter is cached."""
        if id(condition) in self._joint:
            return self.holds(condition, key, candidate)
        satisfied = condition.satisfied_by(candidate)  # which was read just now
        if satisfied is not None:
            return satisfied
        question = (id(condition), key, candidate.id)
        verdict = self._verdicts.get(question)
        if verdict is None:
            verdict = self._verdicts[question] = self.holds(condition, key, candidate)
        return verdict

    def _most_constrained(self, unbound: frozenset[str]) -> tuple[str, list[Element], list[ConditionBase]]:
        """The key with the fewest candidates, these candidates, and the conditions that have selected them. Keys
        whose candidates an index gives come first."""
        found = {key: linked for key in self.patterns if key in unbound and (linked := self._related(key, unbound))}
        if found:
            key = min(found, key=lambda k: len(set.intersection(*found[k].values())))
            wanted = self._indexed(key)
            elements = (self.wmi.find_element(eid) for eid in set.intersection(*found[key].values()))
            matching = self.ordered(e for e in elements if e is not None and self._matches(e, wanted))
            return key, matching, list(found[key])
        domains = {key: self._candidates(key) for key in self.patterns if key in unbound}
        if len(domains) > 1:
            domains = {key: self._filtered(key) for key in domains}
        key = min(domains, key=lambda k: len(domains[k]))
        return key, domains[key], []

    def _filtered(self, key: str) -> list[Element]:
        """The candidates of a key that satisfy the cheap conditions on it alone."""
        cheap = [c for c in self._conditions_on(key) if c.cost <= Cost.ELEMENT]
        alone = [c for c in cheap if self._keys[id(c)] & self.patterns.keys() == {key}]
        found = self._candidates(key)
        for condition in alone:
            found = [e for e in found if self.satisfies(condition, key, e)]
        return found

    def _related(self, key: str, unbound: Collection[str]) -> dict[ConditionBase, set[str]]:
        """The ids that conditions with bound elements allow for a key, by condition."""
        linked = {condition: self.linked(condition, key, unbound) for condition in self._conditions_on(key)}
        return {condition: ids for condition, ids in linked.items() if ids is not None}

    def _conditions_on(self, key: str) -> list[ConditionBase]:
        """The conditions on a key."""
        return [c for c in self.conditions if key in self._keys[id(c)]]

    def linked(self, condition: ConditionBase, key: str, unbound: Collection[str] = ()) -> set[str] | None:
        """The ids that a condition allows for a key; None if no index has them, or another key is not bound."""
        others = self._keys[id(condition)] - {key}
        if not all(self.params.is_bound(other) and other not in unbound for other in others):
            return None
        return condition.candidate_ids(key, self.params, self.wmi)

    # -- elements ----------------------------------------------------------------------------------------------

    def matching(self, key: str) -> list[Element]:
        """All elements that match the pattern of a key, ordered."""
        if self._indexed(key) is self.patterns[key]:
            return self._candidates(key)
        return self._resolved(self.patterns[key])

    def _candidates(self, key: str) -> list[Element]:
        """The elements that match the pattern of a key and its required property values, ordered."""
        if key not in self._known:
            self._known[key] = self._resolved(self._indexed(key))
        return self._known[key]

    def _resolved(self, wanted: Element) -> list[Element]:
        found = self.wmi.resolve_elements(wanted)
        return self.ordered([e for e in found if self._matches(e, wanted)] if wanted.getRelations() else found)

    def _indexed(self, key: str) -> Element:
        """The pattern of a key with required property values, which the scene has an index of."""
        wanted = self.patterns[key]
        for c in self.conditions:
            required = c.indexed_value() if self._keys[id(c)] == {key} else None
            if required is not None:
                wanted = wanted.copy() if wanted is self.patterns[key] else wanted
                if not wanted.hasProperty(required[0]):
                    wanted.setProperty(*required)
        return wanted

    def _matches(self, element: Element, wanted: Element) -> bool:
        if wanted.type in ANY_TYPE:
            wanted = wanted.copy()
            wanted.type = element.type
        return element.isInstance(wanted, self.wmi)

    def ordered(self, elements: Iterable[Element]) -> list[Element]:
        """Sorts elements in the order in which they are tried."""
        by_id = sorted(elements, key=lambda e: id_order(e.id))
        return sorted(by_id, key=lambda e: e.id not in self._preferred) if self._preferred else by_id


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
