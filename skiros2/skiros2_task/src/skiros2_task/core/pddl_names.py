"""Names as PDDL has them: no case, no spaces, few signs. Both ways."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable

from skiros2_common.core.names import full_name, local_name

#: Words that PDDL, or a planner, reads as its own.
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


def pddl_name(text: str) -> str:
    """A text as PDDL can hold it: `skiros:Large Box-1` gives `skiros_large_box-1`."""
    name = re.sub(r"[^a-z0-9_-]", "_", text.lower())
    return name if name[:1].isalpha() else f"n{name}"


class Naming:
    """Gives things names that PDDL can hold, each used once, and finds the things again."""

    def __init__(self) -> None:
        self._names: dict[object, str] = {}
        self._things: dict[str, object] = {}

    def name(self, thing: object, wishes: Iterable[str]) -> str:
        """The thing's name: on first use the first wish that is free, or the last one with a number.

        :param thing: anything that can be a dictionary's key.
        """
        if thing not in self._names:
            wish = chosen = ""
            for wish in map(pddl_name, wishes):
                chosen = f"{wish}_" if wish in _RESERVED else wish
                if chosen not in self._things:
                    break
            count = 2
            while chosen in self._things:
                chosen, count = f"{wish}_{count}", count + 1
            self._names[thing] = chosen
            self._things[chosen] = thing
        return self._names[thing]

    def thing(self, name: str) -> object:
        """What has that name, in any case.

        :raises KeyError: nothing has.
        """
        return self._things[name.lower()]


class NameIndex:
    """Finds names that people wrote with or without prefix, in any case, with `_` for signs that PDDL lacks."""

    def __init__(self) -> None:
        self._exact: dict[str, dict[object, None]] = {}
        self._loose: dict[str, dict[object, None]] = {}
        self._shown: dict[str, str] = {}  # a way to write each name, by what it is compared as

    def add(self, thing: object, *names: str) -> None:
        """Makes a thing known under some names."""
        for name in names:
            self._exact.setdefault(name, {})[thing] = None
            self._loose.setdefault(pddl_name(name), {})[thing] = None
            self._shown.setdefault(pddl_name(name), name)

    def add_prefixed(self, name: str) -> None:
        """Makes a `prefix:Name` known under that name, and without the prefix."""
        self.add(name, name, local_name(name))

    def find(self, text: str) -> list[object]:
        """What is called so: things of exactly that name, else those that differ in case or signs only.

        A name without prefix is first taken for one with the default prefix.
        """
        for known, key in ((self._exact, str), (self._loose, pddl_name)):
            for name in (full_name(text), text):
                if key(name) in known:
                    return list(known[key(name)])
        return []

    def near(self, text: str, count: int = 3) -> list[str]:
        """Known names that look like the text."""
        wanted = pddl_name(text)
        close = difflib.get_close_matches(wanted, list(self._loose), count, 0.7)
        if not close:
            # A name given without its prefix is far from the whole name, but near its end.
            locals_ = {pddl_name(local_name(shown)): key for key, shown in self._shown.items()}
            close = [
                locals_[m] for m in difflib.get_close_matches(pddl_name(local_name(text)), list(locals_), count, 0.7)
            ]
        return list(dict.fromkeys(self._shown[key] for key in close))
