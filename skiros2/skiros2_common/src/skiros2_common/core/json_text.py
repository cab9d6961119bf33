"""JSON texts of others."""

from __future__ import annotations

import json
import re
from typing import Any

#: How deep lists and dicts may be in one another.
_MOST_NESTED = 500
#: Texts, so that what is in them does not count, and the beginnings and ends of lists and dicts.
_TOKENS = re.compile(r'"(?:[^"\\]|\\.)*"|[\[{\]}]', re.DOTALL)


def read_json(text: str) -> Any:
    """The value that a JSON text holds.

    :raises ValueError: it is no JSON, or nested too deeply to be read.
    """
    # Python's parser recurses on the C stack: where the recursion limit was raised, as for deep trees of skills, a text
    # nested without end would end the process.
    if text.count("[") + text.count("{") > _MOST_NESTED and _nesting(text) > _MOST_NESTED:
        raise ValueError("nested too deeply")
    return json.loads(text)


def _nesting(text: str) -> int:
    depth = deepest = 0
    for token in _TOKENS.finditer(text):
        mark = token.group()
        if mark in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif mark in "]}":
            depth -= 1
    return deepest
