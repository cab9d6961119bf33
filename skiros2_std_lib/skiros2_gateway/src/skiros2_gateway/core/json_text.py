"""JSON texts. JSON has no NaN and no infinities: a strict reader refuses the whole text with one of them."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(data: Any) -> str:
    """Returns data as JSON. Numbers that JSON lacks become texts, as does everything that is not JSON data."""
    try:
        return json.dumps(data, default=str, allow_nan=False, separators=(",", ":"))
    except ValueError:  # seldom: the usual data are not copied
        return json.dumps(_finite(data), default=str, allow_nan=False, separators=(",", ":"))


def _finite(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return str(data) if isinstance(data, float) and not math.isfinite(data) else data
