"""Parsing of untrusted JSON."""

from __future__ import annotations

import json
import re
from typing import Any

#: The maximum nesting depth of lists and dicts.
_MAX_DEPTH = 500
#: Strings (whose brackets do not count) and brackets.
_TOKENS = re.compile(r'"(?:[^"\\]|\\.)*"|[\[{\]}]', re.DOTALL)


def read_json(text: str) -> Any:
    """Parses a JSON text.

    :raises ValueError: the text is not JSON, or is nested too deeply.
    """
    # Python's parser recurses on the C stack: with a raised recursion limit (deep skill trees need one), deep nesting
    # would crash the process.
    if text.count("[") + text.count("{") > _MAX_DEPTH and _depth(text) > _MAX_DEPTH:
        raise ValueError("nested too deeply")
    return json.loads(text)


def _depth(text: str) -> int:
    depth = deepest = 0
    for token in _TOKENS.finditer(text):
        bracket = token.group()
        if bracket in "[{":
            depth += 1
            deepest = max(deepest, depth)
        elif bracket in "]}":
            depth -= 1
    return deepest
