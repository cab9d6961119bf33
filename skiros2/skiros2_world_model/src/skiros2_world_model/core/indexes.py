"""The building blocks of a scene: an index of ids, an index of property values, id allocation, shared properties."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Sequence
from contextlib import suppress
from functools import lru_cache
from typing import Any

from skiros2_common.core.element_content import RelationDict
from skiros2_common.core.errors import WrongValue
from skiros2_common.core.names import LAST_ID_NUMBER, id_number
from skiros2_common.core.property import Property, from_text


class IdIndex(dict[Hashable, str | dict[str, None]]):
    """Ids by key. A key with one id stores the id itself, a key with several ids an insertion-ordered dict."""

    __slots__ = ()

    def ids(self, key: Hashable) -> Collection[str]:
        """The ids of a key, as a live view: copy it before changing the index while iterating."""
        known = self.get(key)
        if known is None:
            return ()
        return (known,) if isinstance(known, str) else known.keys()

    def has(self, key: Hashable, eid: str) -> bool:
        """Whether a key has an id."""
        known = self.get(key)
        return eid in known if isinstance(known, dict) else known == eid

    def add(self, key: Hashable, eid: str) -> None:
        """Adds an id to a key; no effect when it is present."""
        known = self.get(key)
        if known is None:
            self[key] = eid
        elif isinstance(known, dict):
            known[eid] = None
        elif known != eid:
            self[key] = {known: None, eid: None}

    def discard(self, key: Hashable, eid: str) -> None:
        """Removes an id from a key; no effect when it is absent."""
        known = self.get(key)
        if known == eid:
            del self[key]
        elif isinstance(known, dict) and eid in known:
            del known[eid]
            if len(known) == 1:
                self[key] = next(iter(known))


#: Keys of bools, which Python would otherwise consider equal to 0 and 1.
_BOOLS = {True: ("bool", True), False: ("bool", False)}

#: The key of all values that are not text, number or bool.
_OTHER = ("other",)


class ValueIndex:
    """Element ids by the values of one property.

    A lookup returns a superset of the elements with an equal value (`same_value`); the caller filters the candidates.
    """

    __slots__ = ("_ids",)

    def __init__(self) -> None:
        self._ids = IdIndex()

    def add(self, eid: str, values: Iterable[Any]) -> None:
        """Indexes the values of an element."""
        for value in values:
            for key in _keys(value):
                self._ids.add(key, eid)

    def discard(self, eid: str, values: Iterable[Any]) -> None:
        """Removes an element with all the values it was indexed with."""
        for value in values:
            for key in _keys(value):
                self._ids.discard(key, eid)

    def candidates(self, value: Any) -> list[Collection[str]] | None:
        """Groups of ids that contain every element with a value; None when the value is not text, number or bool."""
        keys = _keys(value)
        if _OTHER in keys:
            return None
        return [self._ids.ids(key) for key in (*keys, _OTHER)]


def _keys(value: Any) -> Collection[Hashable]:
    """The keys of a value. Values that are equal by `same_value` share at least one key."""
    kind = type(value)
    if kind is float or kind is int:
        return (value,) if value == value else ()  # NaN equals nothing
    if kind is bool:
        return (_BOOLS[value],)
    return _text_keys(value) if kind is str else (_OTHER,)


@lru_cache(10_000)
def _text_keys(text: str) -> frozenset[Hashable]:
    """The text itself, and the number or bool that it denotes."""
    keys: set[Hashable] = {text}
    for kind in (int, float, bool):
        with suppress(WrongValue):
            keys.update(_keys(from_text(text, kind)))
    return frozenset(keys)


class RelationCache:
    """The relations of elements as dicts: of all elements with many relations, and of the others that were read last.

    A read of an element would otherwise look up each predicate in both directions, at places in the memory that the
    processor's cache does not hold in a large scene.
    """

    #: The number of relations of which an element has many.
    MANY = 20
    #: The maximum number of other elements; about 0.5 kB each.
    KEPT = 10_000

    def __init__(self) -> None:
        self._many: dict[str, tuple[RelationDict, ...]] = {}
        self._few: dict[str, tuple[RelationDict, ...]] = {}

    def get(self, eid: str) -> tuple[RelationDict, ...] | None:
        """The relations of an element; None: not known."""
        return self._few.get(eid) or self._many.get(eid)

    def put(self, eid: str, relations: tuple[RelationDict, ...]) -> tuple[RelationDict, ...]:
        """Adds the relations of an element, and returns them."""
        if len(relations) >= self.MANY:
            self._many[eid] = relations
        else:
            if len(self._few) >= self.KEPT:
                self._few.clear()
            self._few[eid] = relations
        return relations

    def discard(self, eid: str) -> None:
        """Removes an element whose relations have changed."""
        self._few.pop(eid, None)
        self._many.pop(eid, None)


class IdNumbers:
    """Counts the ids in use by number and allocates free numbers."""

    def __init__(self) -> None:
        self._counts: dict[int, int] = {}
        #: The lowest number above all numbers ever used. It never decreases, so that no id is reused.
        self.next = 0

    def reserve(self, number: int) -> None:
        """Excludes all numbers below this one from allocation."""
        self.next = max(self.next, number)

    def count(self, eid: str, change: int) -> None:
        """Adds `change` (1 or -1) to the number of elements with that id."""
        number = id_number(eid)
        if number < 0:
            return
        count = self._counts.get(number, 0) + change
        if count:
            self._counts[number] = count
            self.reserve(number + 1)
        else:
            del self._counts[number]

    def free(self, desired: int, others: Sequence[IdNumbers]) -> int:
        """Returns the desired number (from 0) if it is free here and in `others`, else the next free number."""
        everywhere = (self, *others)
        highest = max(numbers.next for numbers in everywhere)
        number = desired if desired >= 0 else highest
        if number in self._counts and len(self._counts) >= self.next:
            number = highest  # all below are taken
        while number > LAST_ID_NUMBER or any(number in numbers._counts for numbers in everywhere):
            number = number + 1 if number < LAST_ID_NUMBER else 0
        return number


_PLAIN = (float, int, bool, str)


class PropertyPool:
    """Interns equal properties: most sizes, states and frames of a cell repeat. Interned properties must not change.

    :param size: the pool is emptied when it holds this many properties.
    """

    def __init__(self, size: int = 10_000) -> None:
        self._size = size
        self._known: dict[Hashable, Property] = {}

    def shared(self, prop: Property) -> Property:
        """Returns an interned property equal in key, type and values, or interns this one."""
        values = prop.values
        datatype = prop.dataType()
        if len(values) > 1 or datatype not in _PLAIN:
            return prop
        value: Hashable = None
        if values:
            value = values[0] or (repr(values[0]),)  # 0.0 == -0.0, but their texts differ
        if len(self._known) >= self._size:
            self._known.clear()
        return self._known.setdefault((prop.key, datatype, value), prop)
