"""Maps names to PDDL names (lower case, no spaces, few signs) and back."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from functools import lru_cache

from skiros2_common.core.names import full_name, local_name

#: Words reserved by PDDL or planners.
_RESERVED = frozenset(
    re.findall(
        r"\S+",
        """
        define domain requirements types constants predicates functions problem objects init goal metric minimize
        maximize action parameters precondition effect and or not imply forall exists when either object number
        increase decrease assign at over start end all total-time total-cost always sometime within undefined
        """,
    )
)


@lru_cache(maxsize=50_000)  # names of elements: each goal asks for all of them after each change
def pddl_name(text: str) -> str:
    """Returns a text as a PDDL name: `skiros:Large Box-1` becomes `skiros_large_box-1`."""
    name = re.sub(r"[^a-z0-9_-]", "_", text.lower())
    return name if name[:1].isalpha() else f"n{name}"


class Naming:
    """Assigns unique PDDL names to keys, and finds keys by name."""

    def __init__(self) -> None:
        self._names: dict[object, str] = {}
        self._keys: dict[str, object] = {}

    def name(self, key: object, candidates: Iterable[str]) -> str:
        """Returns the name of a key. On first use: the first free candidate, or the last one with a number.

        :param key: any hashable object.
        """
        if key not in self._names:
            candidate = chosen = ""
            for candidate in map(pddl_name, candidates):
                chosen = f"{candidate}_" if candidate in _RESERVED else candidate
                if chosen not in self._keys:
                    break
            count = 2
            while chosen in self._keys:
                chosen, count = f"{candidate}_{count}", count + 1
            self._names[key] = chosen
            self._keys[chosen] = key
        return self._names[key]

    def key(self, name: str) -> object:
        """Returns the key of a name, in any case.

        :raises KeyError: the name is not assigned.
        """
        return self._keys[name.lower()]


class NameIndex:
    """Finds keys by names with or without prefix, in any case, with `_` for signs that PDDL lacks."""

    def __init__(self) -> None:
        self._exact: dict[str, dict[object, None]] = {}
        self._loose: dict[str, dict[object, None]] = {}
        self._spelling: dict[str, str] = {}  # the original spelling of each PDDL name

    def add(self, key: object, *names: str) -> None:
        """Adds names of a key."""
        for name in names:
            self._exact.setdefault(name, {})[key] = None
            self._loose.setdefault(pddl_name(name), {})[key] = None
            self._spelling.setdefault(pddl_name(name), name)

    def add_prefixed(self, name: str) -> None:
        """Adds a `prefix:Name` with and without the prefix."""
        self.add(name, name, local_name(name))

    def find(self, text: str) -> list[object]:
        """Returns the keys with exactly this name, or else with a name that differs only in case or signs.

        A name without prefix is first tried with the default prefix.
        """
        for known, key in ((self._exact, str), (self._loose, pddl_name)):
            for name in (full_name(text), text):
                if key(name) in known:
                    return list(known[key(name)])
        return []

    def near_matches(self, text: str, count: int = 3) -> list[str]:
        """Returns known names that are similar to a text."""
        wanted = pddl_name(text)
        close = difflib.get_close_matches(wanted, list(self._loose), count, 0.7)
        if not close:
            # A misspelt name without prefix is similar only to the local name.
            locals_ = {pddl_name(local_name(spelling)): key for key, spelling in self._spelling.items()}
            close = [
                locals_[m] for m in difflib.get_close_matches(pddl_name(local_name(text)), list(locals_), count, 0.7)
            ]
        return list(dict.fromkeys(self._spelling[key] for key in close))
