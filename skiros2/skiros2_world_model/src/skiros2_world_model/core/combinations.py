"""Combinations of elements for several parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element, RelationDict

if TYPE_CHECKING:
    from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

#: Whether a row of elements, by key, satisfies a relation.
_Test = Callable[[dict[str, Element]], bool]


def combinations(wm: WorldModelAbstractInterface, keys: Sequence[str], params: Any) -> Any:
    """The combinations of elements that match the abstract elements of parameters and their relations.

    :param params: a `ParamHandler`.
    :returns: an array of objects with a row for each combination and a column for each key.
    """
    import numpy  # only clients that call this need it

    links = [link for key in keys for link in _links(wm, key, keys, params)]
    rows: list[dict[str, Element]] = [{}]
    for count, key in enumerate(keys, 1):
        known = frozenset(keys[:count])
        tests = [test for needed, test in links if key in needed and needed <= known]
        choices = _choices(wm, key, params)
        extended = ({**row, key: element} for row in rows for element in choices)
        rows = [row for row in extended if all(test(row) for test in tests)]
    found = numpy.empty((len(rows), len(keys)), dtype=object)
    for index, row in enumerate(rows):
        found[index, :] = [row[key] for key in keys]
    return found


def _choices(wm: WorldModelAbstractInterface, key: str, params: Any) -> list[Element]:
    """The candidates for one parameter."""
    value = _element(key, params)
    if value is None:
        return []
    return wm.resolve_elements(value) if value.isAbstract() else [value]


def _links(
    wm: WorldModelAbstractInterface, key: str, keys: Sequence[str], params: Any
) -> Iterator[tuple[frozenset[str], _Test]]:
    """For each relation of an abstract element, the keys that it refers to and its test."""
    value = _element(key, params)
    if value is None or not value.isAbstract():
        return
    for relation in value.getRelations():
        other = relation["dst"] if relation["src"] == "-1" else relation["src"]
        far = _element(other, params) if params.hasParam(other) else wm.find_element(other) or Element("", "", other)
        yield frozenset([key, other] if other in keys else [key]), _test(wm, key, other, relation, far)


def _test(wm: WorldModelAbstractInterface, key: str, other: str, relation: RelationDict, far: Element | None) -> _Test:
    """Creates the test of a relation on a row.

    :param far: the other end of the relation, if the row does not have it.
    """

    def holds(row: dict[str, Element]) -> bool:
        ends = row[key], row.get(other) or far or Element()
        subj, obj = ends if relation["src"] == "-1" else reversed(ends)
        pred = full_name(relation["type"])
        return wm.check_relation(subj, pred, obj, relation["state"], relation["abstract"])

    return holds


def _element(key: str, params: Any) -> Element | None:
    param = params.getParam(key)
    value = param.value if param.value is not None else param.default
    return value if isinstance(value, Element) else None
