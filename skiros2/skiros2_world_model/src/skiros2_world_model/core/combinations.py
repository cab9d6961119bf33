"""The elements that several parameters may have together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from skiros2_common.core.names import full_name
from skiros2_common.core.world_element import Element, RelationDict

if TYPE_CHECKING:
    from skiros2_world_model.core.world_model_client import WorldModelAbstractInterface

#: Whether a row of elements, by key, fits a relation.
_Test = Callable[[dict[str, Element]], bool]


def combinations(wm: WorldModelAbstractInterface, keys: Sequence[str], params: Any) -> Any:
    """The combinations of elements of the scene that fit the abstract elements of some parameters and their relations.

    :param params: a `ParamHandler`.
    :returns: an array of objects; a row for each combination, a column for each key.
    """
    import numpy  # as a client that never asks need not load it

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
    """The elements that one parameter may have."""
    value = _element(key, params)
    if value is None:
        return []
    return wm.resolve_elements(value) if value.isAbstract() else [value]


def _links(
    wm: WorldModelAbstractInterface, key: str, keys: Sequence[str], params: Any
) -> Iterator[tuple[frozenset[str], _Test]]:
    """For each relation noted on an abstract element, the keys that it is about and its test."""
    value = _element(key, params)
    if value is None or not value.isAbstract():
        return
    for relation in value.getRelations():
        other = relation["dst"] if relation["src"] == "-1" else relation["src"]
        far = _element(other, params) if params.hasParam(other) else wm.find_element(other) or Element("", "", other)
        yield frozenset([key, other] if other in keys else [key]), _test(wm, key, other, relation, far)


def _test(wm: WorldModelAbstractInterface, key: str, other: str, relation: RelationDict, far: Element | None) -> _Test:
    """Whether a row fits a relation.

    :param far: the relation's other end where the row does not have it.
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
