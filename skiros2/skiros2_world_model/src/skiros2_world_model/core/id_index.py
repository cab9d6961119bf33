"""Ids by a key, in little memory: the one structure that all indexes of a scene are made of."""

from __future__ import annotations

from collections.abc import Collection, Hashable


class IdIndex(dict[Hashable, str | dict[str, None]]):
    """Ids by key. Most keys have one id, which stands there itself; several are the keys of a dict, in their order."""

    __slots__ = ()

    def ids(self, key: Hashable) -> Collection[str]:
        """The ids of a key. It follows later changes; who changes the index while reading takes a copy."""
        known = self.get(key)
        if known is None:
            return ()
        return (known,) if isinstance(known, str) else known.keys()

    def has(self, key: Hashable, eid: str) -> bool:
        """Whether a key has an id."""
        known = self.get(key)
        return eid in known if isinstance(known, dict) else known == eid

    def add(self, key: Hashable, eid: str) -> None:
        """Gives a key an id, which it may have already."""
        known = self.get(key)
        if known is None:
            self[key] = eid
        elif isinstance(known, dict):
            known[eid] = None
        elif known != eid:
            self[key] = {known: None, eid: None}

    def discard(self, key: Hashable, eid: str) -> None:
        """Takes an id away from a key, if it has it."""
        known = self.get(key)
        if known == eid:
            del self[key]
        elif isinstance(known, dict) and eid in known:
            del known[eid]
            if len(known) == 1:
                self[key] = next(iter(known))
