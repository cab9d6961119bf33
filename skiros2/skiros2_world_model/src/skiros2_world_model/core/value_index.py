"""Which elements have a value of a property, found without looking at all of them."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable
from contextlib import suppress
from functools import lru_cache
from typing import Any

from skiros2_common.core.errors import WrongValue
from skiros2_common.core.property import from_text
from skiros2_world_model.core.id_index import IdIndex

#: Bools are no numbers here, although Python finds True and 1 equal.
_BOOLS = {True: ("bool", True), False: ("bool", False)}

#: Stands for all values that are not of a plain type.
_OTHER = ("other",)


class ValueIndex:
    """The ids of elements by the values that they have of one property.

    It finds no fewer than those that have the value as `same_value` says, and hardly more: who asks checks.
    """

    __slots__ = ("_ids",)

    def __init__(self) -> None:
        self._ids = IdIndex()

    def add(self, eid: str, values: Iterable[Any]) -> None:
        """An element has those values."""
        for value in values:
            for key in _keys(value):
                self._ids.add(key, eid)

    def discard(self, eid: str, values: Iterable[Any]) -> None:
        """An element has those values no more; they are all that it had."""
        for value in values:
            for key in _keys(value):
                self._ids.discard(key, eid)

    def candidates(self, value: Any) -> list[Collection[str]] | None:
        """Groups of ids in which are all elements that have a value; None when it is no text, number or bool."""
        keys = _keys(value)
        if _OTHER in keys:
            return None
        return [self._ids.ids(key) for key in (*keys, _OTHER)]


def _keys(value: Any) -> Collection[Hashable]:
    """The keys of a value. Two values that are the same, as `same_value` says, have one in common."""
    kind = type(value)
    if kind is float or kind is int:
        return (value,) if value == value else ()  # NaN is the same as nothing
    if kind is bool:
        return (_BOOLS[value],)
    return _text_keys(value) if kind is str else (_OTHER,)


@lru_cache(10_000)
def _text_keys(text: str) -> frozenset[Hashable]:
    """The text, and the numbers and bools that it writes."""
    keys: set[Hashable] = {text}
    for kind in (int, float, bool):
        with suppress(WrongValue):
            keys.update(_keys(from_text(text, kind)))
    return frozenset(keys)
