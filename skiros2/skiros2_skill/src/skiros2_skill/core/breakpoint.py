"""A breakpoint, at which tasks pause, as clients name it."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable
from dataclasses import dataclass

from skiros2_common.core.names import full_name

NODE, CONDITION, WORLD = "node", "condition", "world"
BEFORE_START, AT_END, FAILS, CHANGES = "start", "end", "fails", "changes"

#: The events that a breakpoint of each kind can stop at; the first is the default.
WHEN = {NODE: (BEFORE_START, AT_END), CONDITION: (FAILS,), WORLD: (CHANGES,)}


@dataclass(frozen=True)
class Breakpoint:
    """A breakpoint.

    :param kind: `node`, `condition` or `world`.
    :param pattern: a name with optional wildcards `*`, `?` and `[]`, case-insensitive; the prefix of the default
        ontology may be omitted. Matches a node by label, type or `type-label`; a condition by label; a change of the
        world by the id or label of an element, or by a relation.
    :param when: for a node `start` (before it starts) or `end`, for a condition `fails`, for the world `changes`; "":
        the first of these.
    """

    kind: str
    pattern: str
    when: str = ""

    def __str__(self) -> str:
        return f"{self.kind} {self.pattern} {self.when}"

    def matches(self, names: Iterable[str]) -> bool:
        patterns = {self.pattern.lower(), full_name(self.pattern.lower())}
        return any(fnmatch.fnmatchcase(name.lower(), pattern) for name in names if name for pattern in patterns)
