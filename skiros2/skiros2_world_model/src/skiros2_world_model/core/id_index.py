"""Ids by a key, in little memory: the one structure that all indexes of a scene are made of."""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterator


class IdIndex:
    """Ids by key. Most keys have one id, which stands there itself; several are the keys of a dict, in their order."""

    __slots__ = ("_ids",)

    def __init__(self) -> None:
        self._ids: dict[Hashable, str | dict[str, None]] = {}

    def __len__(self) -> int:
        """How many keys have ids."""
        return len(self._ids)

    def __iter__(self) -> Iterator[Hashable]:
        """The keys that have ids."""
        return iter(self._ids)

    def get(self, key: Hashable) -> Collection[str]:
        """The ids of a key. It follows later changes; who changes the index while reading takes a copy."""
        known = self._ids.get(key)
        if known is None:
            return ()
        return (known,) if isinstance(known, str) else known.keys()

    def has(self, key: Hashable, eid: str) -> bool:
        """Whether a key has an id."""
        known = self._ids.get(key)
        return known == eid if known is None or isinstance(known, str) else eid in known

    def add(self, key: Hashable, eid: str) -> None:
        """Gives a key an id, which it may have already."""
        known = self._ids.get(key)
        if known is None:
            self._ids[key] = eid
        elif not isinstance(known, str):
            known[eid] = None
        elif known != eid:
            self._ids[key] = {known: None, eid: None}

    def discard(self, key: Hashable, eid: str) -> None:
        """Takes an id away from a key, if it has it."""
        known = self._ids.get(key)
        if known == eid:
            del self._ids[key]
        elif isinstance(known, dict) and eid in known:
            del known[eid]
            if len(known) == 1:
                self._ids[key] = next(iter(known))
